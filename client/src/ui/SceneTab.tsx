import type { Commands } from "../commands.ts";
import { snapshot } from "../session.ts";
import { PAGE_BANDS, phongTruncation } from "../sh.ts";
import { DEFAULT_VIEW, EV_RANGE, EXPONENT_RANGE, change, isOfStream, view, type BackdropMode, type Theme } from "../view.ts";
import { LightSection } from "./LightSection.tsx";
import { ObjectSection } from "./ObjectSection.tsx";
import { StreamPicker } from "./StreamPicker.tsx";
import { Choice, Section, Slider, Toggle } from "./controls.tsx";

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
/** Up to here 25 coefficients hold the lobe as paper 000 uses it. */
const FULL_LOBE_EXPONENT = 6;

function signed(value: number): string {
  return `${value >= 0 ? "+" : "−"}${Math.abs(value).toFixed(1)}`;
}

/** What the coefficients cannot show of a highlight. */
function lobeWords(exponent: number): string {
  const lost = `${(100 * phongTruncation(exponent, PAGE_BANDS)).toFixed(0)} %`;
  return exponent <= FULL_LOBE_EXPONENT
    ? `25 coefficients hold this lobe to ${lost}.`
    : `Truncated above 6: ${lost} of this lobe is finer than 25 coefficients, so highlights stay wide.`;
}

function ViewSection() {
  const value = view.value;
  const ev = value.ev ?? snapshot.value?.meteredEv ?? 0;
  return (
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
  );
}

function MaterialSection() {
  const value = view.value;
  return (
    <Section title="Material">
      <label class="colour">
        <span class="label">Colour</span>
        <span class="value">{value.colour}</span>
        <input type="color" aria-label="Colour" value={value.colour} onInput={(event) => change({ colour: event.currentTarget.value })} />
      </label>
      <Toggle
        label="Shadows"
        hint="Precomputed transfer of 25 coefficients: the objects shade themselves and each other"
        checked={value.shadows}
        onChange={(shadows) => change({ shadows })}
      />
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
        hint={lobeWords(value.exponent)}
        onInput={(log) => change({ exponent: 2 ** log })}
        onReset={() => change({ exponent: DEFAULT_VIEW.exponent })}
      />
      {value.gloss > 0 && (
        <p class="hint" data-testid="lobe">
          {lobeWords(value.exponent)}
        </p>
      )}
      <Slider
        label="Mirror"
        value={value.mirror}
        min={0}
        max={1}
        step={0.01}
        shown={`${(100 * value.mirror).toFixed(0)} %`}
        hint="Weight of the surroundings' mirror image (equation 15 of paper 003)"
        onInput={(mirror) => change({ mirror })}
        onReset={() => change({ mirror: DEFAULT_VIEW.mirror })}
      />
    </Section>
  );
}

export function SceneTab({ commands }: { commands: Commands }) {
  return (
    <>
      {isOfStream(view.value.light) && <StreamPicker commands={commands} />}
      <LightSection />
      <ObjectSection />
      <MaterialSection />
      <ViewSection />
      <footer>
        <Choice label="Theme" value={view.value.theme} options={THEMES} onChange={(theme) => change({ theme })} />
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
    </>
  );
}
