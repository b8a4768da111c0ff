import type { ComponentChildren } from "preact";
import { useState } from "preact/hooks";

import type { Vector3 } from "../sh.ts";

const AXES = ["x", "y", "z"];

/** A number in metres, taken when it has been typed to its end; what is being typed is left alone meanwhile. */
function Metres({ label, value, onChange }: { label: string; value: number; onChange: (value: number) => void }) {
  const [draft, setDraft] = useState<string | null>(null);
  return (
    <input
      type="number"
      step={0.05}
      value={draft ?? String(Number(value.toFixed(3)))}
      aria-label={label}
      onInput={(event) => setDraft(event.currentTarget.value)}
      onChange={(event) => {
        setDraft(null);
        if (Number.isFinite(event.currentTarget.valueAsNumber)) onChange(event.currentTarget.valueAsNumber);
      }}
    />
  );
}

interface Props {
  /** What stands there, as "Live probe". */
  name: string;
  hint: string;
  place: Vector3;
  onChange: (place: Vector3) => void;
  children?: ComponentChildren;
}

/** A place in world metres that can be typed. */
export function PlaceInput({ name, hint, place, onChange, children }: Props) {
  return (
    <fieldset class="place" title={hint}>
      <legend class="label">{name} at, metres</legend>
      {AXES.map((axis, k) => (
        <Metres
          key={axis}
          label={`${name}, ${axis} in metres`}
          value={place[k]!}
          onChange={(value) => onChange(place.map((before, i) => (i === k ? value : before)) as unknown as Vector3)}
        />
      ))}
      {children}
    </fieldset>
  );
}
