// A list of objects, such as the cameras of a path: one row each, with a cell for each of its values.

import type { Field } from "../jobs/schema.ts";
import { written } from "../jobs/schema.ts";
import { cellOf, draftOfRows, moved, rowsOf, withCell, without, type Row } from "../jobs/rows.ts";

/** Where else a row may come from than from typing. */
export interface RowSource {
  label: string;
  make: () => Row | null;
}

interface Props {
  field: Field;
  typed: string | boolean | undefined;
  source: RowSource | undefined;
  describedBy: string;
  onChange: (typed: string) => void;
}

export function RowsInput({ field, typed, source, describedBy, onChange }: Props) {
  const rows = rowsOf(typed);
  const set = (changed: readonly Row[]) => onChange(draftOfRows(changed));
  const add = (row: Row | null | undefined) => row !== null && set([...rows, row ?? {}]);
  return (
    <fieldset class="rows" aria-describedby={describedBy}>
      <legend class="label">{field.label}</legend>
      {rows.length > 0 && (
        <ol>
          {rows.map((row, at) => (
            <li key={at}>
              <div class="cells">
                {field.columns.map((column) => (
                  <label key={column.path} title={column.hint}>
                    <span>{column.label}</span>
                    <input
                      type="text"
                      autocomplete="off"
                      spellcheck={false}
                      aria-label={`${field.label} ${at + 1}: ${column.label}`}
                      value={cellOf(row, column)}
                      placeholder={written(column.fallback)}
                      onInput={(event) => set(withCell(rows, at, column, event.currentTarget.value))}
                    />
                  </label>
                ))}
              </div>
              <div class="buttons">
                <button type="button" disabled={at === 0} aria-label={`Move ${at + 1} up`} onClick={() => set(moved(rows, at, -1))}>
                  ↑
                </button>
                <button
                  type="button"
                  disabled={at === rows.length - 1}
                  aria-label={`Move ${at + 1} down`}
                  onClick={() => set(moved(rows, at, 1))}
                >
                  ↓
                </button>
                <button type="button" aria-label={`Remove ${at + 1}`} onClick={() => set(without(rows, at))}>
                  Remove
                </button>
              </div>
            </li>
          ))}
        </ol>
      )}
      <div class="buttons">
        <button type="button" onClick={() => add(rows.at(-1))}>
          Add one
        </button>
        {source !== undefined && (
          <button type="button" onClick={() => add(source.make())}>
            {source.label}
          </button>
        )}
      </div>
    </fieldset>
  );
}
