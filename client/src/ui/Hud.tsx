import { snapshot } from "../session.ts";
import { view } from "../view.ts";

function Figure({ name, value, unit, title }: { name: string; value: string; unit?: string; title: string }) {
  return (
    <div title={title}>
      <dt>{name}</dt>
      <dd data-testid={`hud-${name.toLowerCase()}`}>
        {value}
        {unit !== undefined && <small> {unit}</small>}
      </dd>
    </div>
  );
}

/** Numbers over the picture. */
export function Hud() {
  const now = snapshot.value;
  if (now === null) return null;
  const render = now.renderFps < 0.5 ? "idle" : now.renderFps.toFixed(0);
  const isField = view.value.light === "field";
  const fps = isField ? now.field.fps : now.streamFps;
  const latency = isField || now.latencyMs === null ? "–" : now.latencyMs.toFixed(now.latencyMs < 10 ? 1 : 0);
  return (
    <dl class="hud" aria-label="Measurements">
      <Figure
        name="Render"
        value={render}
        {...(render === "idle" ? {} : { unit: "fps" })}
        title="Pictures drawn each second; nothing is drawn while nothing changes"
      />
      <Figure
        name={isField ? "Field" : "Stream"}
        value={fps.toFixed(fps < 10 ? 1 : 0)}
        unit="fps"
        title={isField ? "Frames received each second, of all its streams" : "Frames received each second"}
      />
      <Figure
        name="Latency"
        value={latency}
        {...(latency === "–" ? {} : { unit: "ms" })}
        title={`Median of two seconds: ${now.latencyLabel}`}
      />
      <Figure name="Missed" value={String(isField ? now.field.missed : now.missed)} title="Frames overtaken by newer ones before they reached this page" />
    </dl>
  );
}
