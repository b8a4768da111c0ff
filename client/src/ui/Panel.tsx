import type { RefObject } from "preact";

import type { Commands } from "../commands.ts";
import { view } from "../view.ts";
import { Badge, Trouble } from "./Badge.tsx";
import { CapturesTab } from "./CapturesTab.tsx";
import { FilesTab } from "./FilesTab.tsx";
import { GridsTab } from "./GridsTab.tsx";
import { JobsTab } from "./JobsTab.tsx";
import { SceneTab } from "./SceneTab.tsx";
import { StreamsTab } from "./StreamsTab.tsx";
import { Tabs } from "./Tabs.tsx";
import { IconButton } from "./controls.tsx";

const CHEVRON = "M5 8l5 5 5-5";

function Body({ commands }: { commands: Commands }) {
  switch (view.value.tab) {
    case "scene":
      return <SceneTab commands={commands} />;
    case "streams":
      return <StreamsTab />;
    case "jobs":
      return <JobsTab />;
    case "captures":
      return <CapturesTab />;
    case "grids":
      return <GridsTab />;
    case "files":
      return <FilesTab />;
  }
}

export function Panel({ commands, element }: { commands: Commands; element: RefObject<HTMLElement | null> }) {
  const open = commands.panelIsOpen();
  const { tab } = view.value;
  return (
    <aside class={open ? "panel" : "panel closed"} ref={element} aria-label="Lightwell">
      <header>
        <svg class="mark" viewBox="0 0 32 32" aria-hidden="true">
          <circle cx="16" cy="16" r="10" />
          <path d="M16 6a10 10 0 0 1 10 10c-5-1-9-5-10-10z" />
        </svg>
        <h1>Lightwell</h1>
        <Badge />
        <IconButton
          label={open ? "Close the panel" : "Open the panel"}
          path={CHEVRON}
          pressed={open}
          onClick={() => commands.togglePanel()}
        />
      </header>
      {open && (
        <>
          <Tabs />
          <div class="body" id="panel-body" role="tabpanel" aria-labelledby={`tab-${tab}`} key={tab}>
            <Trouble />
            <Body commands={commands} />
          </div>
        </>
      )}
    </aside>
  );
}
