// Inputs of the panel: native elements with a label and a value.

import type { ComponentChildren } from "preact";

interface SliderProps {
  label: string;
  value: number;
  min: number;
  max: number;
  step: number;
  shown: string;
  hint?: string;
  onInput: (value: number) => void;
  onReset: () => void;
}

/** A slider; a double click resets it. */
export function Slider({ label, value, min, max, step, shown, hint, onInput, onReset }: SliderProps) {
  const filled = `${(100 * (value - min)) / (max - min)}%`;
  return (
    <label class="slider" title={hint ?? "Double click resets"}>
      <span class="label">{label}</span>
      <span class="value">{shown}</span>
      <input
        type="range"
        min={min}
        max={max}
        step={step}
        value={value}
        style={{ "--filled": filled }}
        aria-label={label}
        aria-valuetext={shown}
        onInput={(event) => onInput(event.currentTarget.valueAsNumber)}
        onDblClick={onReset}
      />
    </label>
  );
}

interface ChoiceProps<T extends string | number> {
  label: string;
  value: T;
  options: readonly { value: T; label: string; hint?: string }[];
  onChange: (value: T) => void;
}

/** A row of exclusive buttons (radio inputs, so arrow keys work). */
export function Choice<T extends string | number>({ label, value, options, onChange }: ChoiceProps<T>) {
  return (
    <fieldset class="choice">
      <legend class="label">{label}</legend>
      <div class="segments">
        {options.map((option) => (
          <label key={option.value} title={option.hint}>
            <input
              type="radio"
              name={label}
              value={option.value}
              checked={option.value === value}
              onChange={() => onChange(option.value)}
            />
            <span>{option.label}</span>
          </label>
        ))}
      </div>
    </fieldset>
  );
}

interface ToggleProps {
  label: string;
  checked: boolean;
  hint?: string;
  disabled?: boolean;
  onChange: (checked: boolean) => void;
}

export function Toggle({ label, checked, hint, disabled = false, onChange }: ToggleProps) {
  return (
    <label class="toggle" title={hint}>
      <span class="label">{label}</span>
      <input
        type="checkbox"
        role="switch"
        checked={checked}
        disabled={disabled}
        onChange={(event) => onChange(event.currentTarget.checked)}
      />
    </label>
  );
}

export function Section({ title, aside, children }: { title: string; aside?: string; children: ComponentChildren }) {
  return (
    <section>
      <h2>
        {title}
        {aside !== undefined && <small>{aside}</small>}
      </h2>
      {children}
    </section>
  );
}

/** An icon button. */
export function IconButton(props: { label: string; path: string; pressed?: boolean; onClick: () => void }) {
  return (
    <button
      type="button"
      class="icon"
      aria-label={props.label}
      title={props.label}
      aria-pressed={props.pressed}
      onClick={props.onClick}
    >
      <svg viewBox="0 0 20 20" aria-hidden="true">
        <path d={props.path} />
      </svg>
    </button>
  );
}
