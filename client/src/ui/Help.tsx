import { useEffect, useRef } from "preact/hooks";

const KEYS: [string[], string][] = [
  [["drag"], "orbit"],
  [["right drag"], "pan"],
  [["wheel"], "zoom"],
  [["double click"], "look at that point"],
  [["←", "→", "↑", "↓"], "orbit, with the picture focused"],
  [["+", "−"], "zoom, with the picture focused"],
  [["R"], "reset the camera"],
  [["F"], "frame the objects"],
  [["Space"], "pause and follow"],
  [[",", "."], "a frame back, a frame on"],
  [["N", "M", "J", "U", "K", "I"], "move the object in a grid or beside probes: left, right, nearer, farther, down, up"],
  [["Shift"], "with these: move the live probe, where its stream does not say where it stands"],
  [["G"], "handles that move the object; with Shift, the live probe"],
  [["B"], "next backdrop"],
  [["A"], "dominant light"],
  [["H"], "measurements"],
  [["P"], "panel"],
  [["1", "…", "6"], "its tabs: scene, streams, jobs, captures, grids, files"],
  [["S"], "screenshot"],
  [["L"], "copy link"],
  [["?"], "this help"],
];

export function Help({ onClose }: { onClose: () => void }) {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => dialog.current!.showModal(), []);
  return (
    <dialog class="help" ref={dialog} aria-labelledby="help-title" onClose={onClose}>
      <header>
        <h2 id="help-title">Keys and mouse</h2>
        <form method="dialog">
          <button type="submit">Close</button>
        </form>
      </header>
      <dl>
        {KEYS.map(([keys, meaning]) => (
          <div key={meaning}>
            <dt>
              {keys.map((key) => (
                <kbd key={key}>{key}</kbd>
              ))}
            </dt>
            <dd>{meaning}</dd>
          </div>
        ))}
      </dl>
    </dialog>
  );
}
