// A form whose fields come from a JSON schema: those that matter most first, the rest behind "More".

import { useEffect, useRef } from "preact/hooks";

import type { FieldError } from "../api.ts";
import { complaint, written, type Draft, type Field } from "../jobs/schema.ts";
import { RowsInput, type RowSource } from "./RowsInput.tsx";

export interface Suggestion {
  value: string;
  label: string;
}

interface Props {
  fields: readonly Field[];
  /** Paths that are shown at once; those that are required come along. */
  basic: readonly string[];
  draft: Draft;
  onChange: (draft: Draft) => void;
  errors: readonly FieldError[];
  /** Paths for which there is a list to choose from. */
  choices?: Readonly<Record<string, readonly Suggestion[]>>;
  /** Paths for which something else may be typed too. */
  suggestions?: Readonly<Record<string, readonly Suggestion[]>>;
  /** Paths of lists whose rows may come from elsewhere. */
  rowSources?: Readonly<Record<string, RowSource>>;
}

export function SchemaForm({ fields, basic, draft, onChange, errors, choices = {}, suggestions = {}, rowSources = {} }: Props) {
  const root = useRef<HTMLDivElement>(null);
  useEffect(() => {
    // What is wrong may have been scrolled away.
    if (errors.length > 0) root.current!.querySelector<HTMLElement>(".field.invalid :is(input, select)")?.focus();
  }, [errors]);
  const rank = (field: Field) => (basic.includes(field.path) ? basic.indexOf(field.path) : field.required ? -1 : Infinity);
  const first = fields.filter((field) => rank(field) < Infinity).sort((a, b) => rank(a) - rank(b));
  const others = fields.filter((field) => rank(field) === Infinity);
  const wrongOthers = others.some((field) => complaint(field, errors) !== "");
  const show = (field: Field) => (
    <FieldInput
      key={field.path}
      field={field}
      typed={draft[field.path]}
      error={complaint(field, errors)}
      choices={choices[field.path]}
      suggestions={suggestions[field.path] ?? []}
      rowSource={rowSources[field.path]}
      onChange={(value) => onChange({ ...draft, [field.path]: value })}
    />
  );
  return (
    <div class="form" ref={root}>
      {first.map(show)}
      {others.length > 0 && (
        <details class="more" {...(wrongOthers ? { open: true } : {})}>
          <summary>More settings</summary>
          <div class="form">{others.map(show)}</div>
        </details>
      )}
    </div>
  );
}

interface FieldProps {
  field: Field;
  typed: string | boolean | undefined;
  error: string;
  choices: readonly Suggestion[] | undefined;
  suggestions: readonly Suggestion[];
  rowSource: RowSource | undefined;
  onChange: (value: string | boolean) => void;
}

function FieldInput({ field, typed, error, choices, suggestions, rowSource, onChange }: FieldProps) {
  const id = `field-${field.path}`;
  const fallback = written(field.fallback);
  const common = {
    id,
    "aria-invalid": error !== "",
    "aria-describedby": `${id}-hint`,
    title: field.hint,
  };
  const value = typeof typed === "string" ? typed : undefined;
  let input;
  if (field.input === "flag") {
    const checked = typeof typed === "boolean" ? typed : field.fallback === true;
    input = (
      <input
        {...common}
        type="checkbox"
        role="switch"
        class="switch"
        checked={checked}
        onChange={(event) => onChange(event.currentTarget.checked)}
      />
    );
  } else if (field.input === "rows") {
    input = <RowsInput field={field} typed={typed} source={rowSource} describedBy={`${id}-hint`} onChange={onChange} />;
  } else if (choices !== undefined || field.input === "choice") {
    const options = choices ?? field.options.map((option) => ({ value: option, label: option }));
    const shown = value ?? fallback;
    input = (
      <select {...common} value={shown} onChange={(event) => onChange(event.currentTarget.value)}>
        {!options.some((option) => option.value === shown) && (
          <option value={shown}>{shown !== "" ? shown : field.required ? "choose…" : "default"}</option>
        )}
        {options.map((option) => (
          <option key={option.value} value={option.value}>
            {option.label}
          </option>
        ))}
      </select>
    );
  } else {
    const isNumber = field.input === "number" || field.input === "integer";
    input = (
      <input
        {...common}
        type="text"
        inputMode={isNumber ? "decimal" : "text"}
        autocomplete="off"
        spellcheck={false}
        value={value ?? ""}
        placeholder={fallback === "" ? (field.required ? "" : "default") : fallback}
        {...(suggestions.length > 0 ? { list: `${id}-list` } : {})}
        onInput={(event) => onChange(event.currentTarget.value)}
      />
    );
  }
  return (
    <div class={error === "" ? "field" : "field invalid"}>
      {field.input !== "rows" && <label for={id}>{field.label}</label>}
      {input}
      {choices === undefined && suggestions.length > 0 && (
        <datalist id={`${id}-list`}>
          {suggestions.map((one) => (
            <option key={one.value} value={one.value}>
              {one.label}
            </option>
          ))}
        </datalist>
      )}
      <p class="hint" id={`${id}-hint`}>
        {error !== "" ? <strong>{error}</strong> : field.hint}
      </p>
    </div>
  );
}
