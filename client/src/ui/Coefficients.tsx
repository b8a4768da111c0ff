import { snapshot } from "../session.ts";

const HEIGHT = 74;
const COLUMN = 10;
const GAP = 4;
const CHANNELS = ["red", "green", "blue"] as const;

/** Signed bars of the coefficients, three a column, on a square-root scale so that small ones can be seen. */
export function Coefficients() {
  const coefficients = snapshot.value?.coefficients ?? null;
  if (coefficients === null) return <p class="muted">No light yet.</p>;
  const count = coefficients.length / 3;
  const bands = Math.sqrt(count);
  const left = (index: number) => COLUMN * index + GAP * Math.floor(Math.sqrt(index));
  const width = left(count - 1) + COLUMN;
  const largest = coefficients.reduce((most, value) => Math.max(most, Math.abs(value)), 1e-9);
  const middle = HEIGHT / 2;
  const length = (value: number) => (middle - 2) * Math.sqrt(Math.abs(value) / largest);
  return (
    <svg
      class="coefficients"
      viewBox={`0 0 ${width} ${HEIGHT + 12}`}
      role="img"
      aria-label={`${count} coefficients in ${bands} bands; the first is ${coefficients[0]!.toPrecision(3)}`}
    >
      {Array.from({ length: bands }, (_, degree) => {
        const from = left(degree * degree);
        const to = left((degree + 1) ** 2 - 1) + COLUMN - 1;
        return (
          <g key={degree}>
            <line class="axis" x1={from} x2={to} y1={middle} y2={middle} />
            <text x={(from + to) / 2} y={HEIGHT + 9}>
              {degree}
            </text>
          </g>
        );
      })}
      {Array.from({ length: count }, (_, index) => {
        const degree = Math.floor(Math.sqrt(index));
        const order = index - degree * degree - degree;
        const rgb = [0, 1, 2].map((channel) => coefficients[3 * index + channel]!);
        return (
          <g key={index}>
            <title>{`l ${degree}, m ${order}: ${rgb.map((value) => value.toPrecision(3)).join("  ")}`}</title>
            {rgb.map((value, channel) => (
              <rect
                key={channel}
                class={CHANNELS[channel]}
                x={left(index) + 3 * channel}
                width={2.4}
                y={value >= 0 ? middle - length(value) : middle}
                height={Math.max(length(value), 0.4)}
              />
            ))}
          </g>
        );
      })}
    </svg>
  );
}
