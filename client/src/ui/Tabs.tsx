import { computed } from "@preact/signals";

import { unfinished } from "../jobs/store.ts";
import { TABS, change, view, type Tab } from "../view.ts";

const LABELS: Record<Tab, string> = {
  scene: "Scene",
  streams: "Streams",
  jobs: "Jobs",
  captures: "Captures",
  grids: "Grids",
  files: "Files",
};

const running = computed(() => unfinished.value.length);

/** Choose what the panel shows; left and right go along the row, as in other tab lists. */
export function Tabs() {
  const { tab } = view.value;
  const move = (event: KeyboardEvent) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    const goal = { Home: 0, End: TABS.length - 1 }[event.key];
    if (step === undefined && goal === undefined) return;
    const index = goal ?? (TABS.indexOf(view.peek().tab) + step! + TABS.length) % TABS.length;
    change({ tab: TABS[index]! });
    event.preventDefault();
    (event.currentTarget as HTMLElement).querySelectorAll<HTMLElement>("[role=tab]")[index]!.focus();
  };
  return (
    <div class="tabs" role="tablist" aria-label="Panel" onKeyDown={move}>
      {TABS.map((name) => (
        <button
          key={name}
          type="button"
          role="tab"
          id={`tab-${name}`}
          aria-selected={name === tab}
          aria-controls="panel-body"
          tabIndex={name === tab ? 0 : -1}
          onClick={() => change({ tab: name })}
        >
          {LABELS[name]}
          {name === "jobs" && running.value > 0 && (
            <span class="count" aria-label={`${running.value} unfinished`}>
              {running.value}
            </span>
          )}
        </button>
      ))}
    </div>
  );
}
