// Inputs of the panel: native elements with a label and a value.

import type { ComponentChildren } from "preact";
import { useEffect, useId, useState } from "preact/hooks";

interface SliderProps {
  disabled?: boolean;
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
export function Slider({ label, value, min, max, step, shown, hint, disabled = false, onInput, onReset }: SliderProps) {
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
        disabled={disabled}
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
  const group = useId();
  return (
    <fieldset class="choice">
      <legend class="label">{label}</legend>
      <div class="segments">
        {options.map((option) => (
          <label key={option.value} title={option.hint}>
            <input
              type="radio"
              name={group}
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

/** How far something is, 0 … 1; `null`: nobody knows. */
export function Meter({ label, share, tone = "" }: { label: string; share: number | null; tone?: string }) {
  const percent = share === null ? null : Math.round(100 * Math.min(1, Math.max(0, share)));
  return (
    <div
      class={`meter ${tone} ${percent === null ? "unknown" : ""}`}
      role="progressbar"
      aria-label={label}
      aria-valuemin={0}
      aria-valuemax={100}
      {...(percent === null ? {} : { "aria-valuenow": percent })}
    >
      <span style={{ width: `${percent ?? 100}%` }} />
    </div>
  );
}

const CONFIRM_MS = 4000;

/** A button for what cannot be undone: it asks again before it acts. */
export function ConfirmButton({ label, question, onConfirm }: { label: string; question: string; onConfirm: () => void }) {
  const [asking, setAsking] = useState(false);
  useEffect(() => {
    if (!asking) return;
    const timer = setTimeout(() => setAsking(false), CONFIRM_MS);
    return () => clearTimeout(timer);
  }, [asking]);
  return (
    <button
      type="button"
      class={asking ? "danger" : ""}
      onClick={() => {
        setAsking(!asking);
        if (asking) onConfirm();
      }}
    >
      {asking ? question : label}
    </button>
  );
}

/** What is said where a list is empty. */
export function Nothing({ title, children }: { title: string; children: ComponentChildren }) {
  return (
    <div class="nothing">
      <h3>{title}</h3>
      {children}
    </div>
  );
}

/** What went wrong, beside where it did. */
export function Wrong({ text, children }: { text: string; children?: ComponentChildren }) {
  if (text === "") return null;
  return (
    <div class="wrong" role="alert">
      <p>{text}</p>
      {children}
    </div>
  );
}

/** A line that is to be typed into a terminal, with a button that copies it. */
export function Command({ line }: { line: string }) {
  const [copied, setCopied] = useState(false);
  const copy = () => {
    // Without TLS there is no clipboard: the text can still be selected.
    void navigator.clipboard?.writeText(line).then(() => setCopied(true), () => undefined);
  };
  return (
    <div class="command">
      <code>{line}</code>
      <button type="button" onClick={copy}>
        {copied ? "Copied" : "Copy"}
      </button>
    </div>
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
