import { effect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import "uplot/dist/uPlot.min.css";

import { HISTORY_MS } from "../live.ts";
import { snapshot } from "../session.ts";
import { view } from "../view.ts";

const HEIGHT = 92;

/** Latency over the last half minute. uPlot is fetched when the graph is first shown. */
export function LatencyGraph() {
  const host = useRef<HTMLDivElement>(null);
  const { theme } = view.value;
  useEffect(() => {
    const element = host.current!;
    let stop: (() => void) | undefined;
    let gone = false;
    void import("uplot").then(({ default: Plot }) => {
      if (gone) return;
      const style = getComputedStyle(element);
      const colour = (name: string) => style.getPropertyValue(name).trim();
      const axis = {
        stroke: colour("--muted"),
        font: `10px ${style.fontFamily}`,
        grid: { stroke: colour("--line"), width: 1 },
        ticks: { show: false },
        gap: 3,
      };
      const plot = new Plot(
        {
          width: element.clientWidth,
          height: HEIGHT,
          padding: [6, 14, 0, 0],
          legend: { show: false },
          cursor: { show: false },
          scales: { x: { time: false, range: [-HISTORY_MS / 1000, 0] }, y: { range: (_, __, most) => [0, Math.max(5, 1.15 * most)] } },
          axes: [
            { ...axis, size: 22, values: (_, ticks) => ticks.map((tick) => (tick === 0 ? "now" : `−${-tick} s`)), space: 60 },
            { ...axis, size: 34, space: 26, gap: 6 },
          ],
          series: [
            {},
            { stroke: colour("--accent"), width: 1.25, fill: colour("--accent-faint"), points: { show: false } },
          ],
        },
        [[], []],
        element,
      );
      const disposeEffect = effect(() => {
        const now = snapshot.value;
        if (now === null) return;
        const samples = now.latencies;
        plot.setData([samples.map((sample) => (sample.timeMs - now.timeMs) / 1000), samples.map((sample) => sample.value)]);
      });
      const observer = new ResizeObserver(() => {
        if (element.clientWidth > 0) plot.setSize({ width: element.clientWidth, height: HEIGHT });
      });
      observer.observe(element);
      stop = () => {
        observer.disconnect();
        disposeEffect();
        plot.destroy();
      };
    });
    return () => {
      gone = true;
      stop?.();
    };
  }, [theme]);
  const label = snapshot.value?.latencyLabel ?? "";
  return <div class="graph" ref={host} role="img" aria-label={`Latency of the last half minute, milliseconds: ${label}`} title={label} />;
}
