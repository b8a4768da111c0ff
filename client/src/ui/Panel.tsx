import type { RefObject } from "preact";

import type { Commands } from "../commands.ts";
import { chooseStream, paused, snapshot, streams } from "../session.ts";
import { PAGE_BANDS } from "../sh.ts";
import { DEFAULT_VIEW, EV_RANGE, EXPONENT_RANGE, change, view, type BackdropMode, type Theme } from "../view.ts";
import { Badge, Trouble } from "./Badge.tsx";
import { Coefficients } from "./Coefficients.tsx";
import { Health } from "./Health.tsx";
import { LatencyGraph } from "./LatencyGraph.tsx";
import { Choice, IconButton, Section, Slider, Toggle } from "./controls.tsx";

const BACKDROPS: { value: BackdropMode; label: string; hint: string }[] = [
  { value: "picture", label: "Picture", hint: "The probe's picture of the surroundings" },
  { value: "harmonics", label: "Harmonics", hint: "The light as the coefficients hold it" },
  { value: "off", label: "Off", hint: "No backdrop" },
];
const THEMES: { value: Theme; label: string }[] = [
  { value: "auto", label: "System" },
  { value: "dark", label: "Dark" },
  { value: "light", label: "Light" },
];
const BANDS = Array.from({ length: PAGE_BANDS }, (_, i) => ({
  value: i + 1,
  label: String(i + 1),
  hint: `${(i + 1) ** 2} coefficients`,
}));

const CHEVRON = "M5 8l5 5 5-5";

function signed(value: number): string {
  return `${value >= 0 ? "+" : "−"}${Math.abs(value).toFixed(1)}`;
}

function StreamPicker() {
  const names = (streams.value ?? []).map(({ name }) => name);
  const { stream } = view.value;
  if (stream !== null && !names.includes(stream)) names.unshift(stream);
  const info = snapshot.value?.info;
  return (
    <div class="stream">
      <label class="picker">
        <span class="label">Stream</span>
        <select
          aria-label="Stream"
          value={stream ?? ""}
          disabled={names.length === 0}
          onChange={(event) => chooseStream(event.currentTarget.value)}
        >
          {names.length === 0 && <option value="">none yet</option>}
          {names.map((name) => (
            <option key={name} value={name}>
              {name}
            </option>
          ))}
        </select>
      </label>
      <button
        type="button"
        class="follow"
        aria-pressed={paused.value}
        title="Hold the light that is shown, or follow the newest (Space)"
        onClick={() => (paused.value = !paused.value)}
      >
        {paused.value ? "Follow" : "Pause"}
      </button>
      {info && (
        <p class="muted" title={info.source}>
          {info.mapping}, {info.bands} bands, {info.units === "relative" ? "relative units" : "W·sr⁻¹·m⁻²"}
        </p>
      )}
    </div>
  );
}

export function Panel({ commands, element }: { commands: Commands; element: RefObject<HTMLElement | null> }) {
  const value = view.value;
  const open = commands.panelIsOpen();
  const ev = value.ev ?? snapshot.value?.meteredEv ?? 0;
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
        <div class="body">
          <Trouble />
          <StreamPicker />
          <Section title="Light" aside={`${value.bands ** 2} of ${(snapshot.value?.frame?.bands ?? PAGE_BANDS) ** 2} coefficients`}>
            <Coefficients />
            <Choice label="Bands" value={value.bands} options={BANDS} onChange={(bands) => change({ bands })} />
            <Toggle
              label="Dominant light"
              hint="An arrow that points the way the strongest light travels (A)"
              checked={value.arrow}
              onChange={(arrow) => change({ arrow })}
            />
          </Section>
          <Section title="View">
            <Slider
              label="Exposure"
              value={ev}
              {...EV_RANGE}
              step={0.1}
              shown={`${signed(ev)} EV${value.ev === null ? " auto" : ""}`}
              hint="Double click: metered automatically, following the light slowly"
              onInput={(chosen) => change({ ev: chosen })}
              onReset={() => change({ ev: null })}
            />
            <Choice label="Backdrop" value={value.backdrop} options={BACKDROPS} onChange={(backdrop) => change({ backdrop })} />
          </Section>
          <Section title="Material">
            <label class="colour">
              <span class="label">Colour</span>
              <span class="value">{value.colour}</span>
              <input type="color" aria-label="Colour" value={value.colour} onInput={(event) => change({ colour: event.currentTarget.value })} />
            </label>
            <Slider
              label="Gloss"
              value={value.gloss}
              min={0}
              max={1}
              step={0.01}
              shown={`${(100 * value.gloss).toFixed(0)} %`}
              onInput={(gloss) => change({ gloss })}
              onReset={() => change({ gloss: DEFAULT_VIEW.gloss })}
            />
            <Slider
              label="Phong exponent"
              value={Math.log2(value.exponent)}
              min={Math.log2(EXPONENT_RANGE.min)}
              max={Math.log2(EXPONENT_RANGE.max)}
              step={0.05}
              shown={value.exponent.toFixed(value.exponent < 10 ? 1 : 0)}
              onInput={(log) => change({ exponent: 2 ** log })}
              onReset={() => change({ exponent: DEFAULT_VIEW.exponent })}
            />
            <Toggle
              label="Shadows"
              hint="Baked transfer of 25 coefficients: the objects shade themselves and each other"
              checked={value.shadows}
              onChange={(shadows) => change({ shadows })}
            />
          </Section>
          <Section title="Latency" aside="ms, capture to page">
            <LatencyGraph />
          </Section>
          <Section title="Newest frame">
            <Health />
          </Section>
          <footer>
            <Choice label="Theme" value={value.theme} options={THEMES} onChange={(theme) => change({ theme })} />
            <div class="actions">
              <button type="button" onClick={() => void commands.copyLink()}>
                Copy link
              </button>
              <button type="button" onClick={() => void commands.saveScreenshot()}>
                Screenshot
              </button>
              <button type="button" onClick={() => commands.toggleHelp()}>
                Help
              </button>
            </div>
          </footer>
        </div>
      )}
    </aside>
  );
}
