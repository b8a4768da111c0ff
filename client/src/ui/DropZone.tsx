import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";

import { refuseFolder, takeFiles } from "../uploads.ts";

function hasFiles(event: DragEvent): boolean {
  return event.dataTransfer?.types.includes("Files") ?? false;
}

/** The whole page takes files; while some are held over it, it says what becomes of them. */
export function DropZone() {
  const over = useSignal(false);
  useEffect(() => {
    // Elements inside tell of entering and leaving, too: count.
    let depth = 0;
    const enter = (event: DragEvent) => {
      if (!hasFiles(event)) return;
      event.preventDefault();
      depth++;
      over.value = true;
    };
    const move = (event: DragEvent) => {
      if (!hasFiles(event)) return;
      event.preventDefault();
      event.dataTransfer!.dropEffect = "copy";
    };
    const leave = (event: DragEvent) => {
      if (!hasFiles(event)) return;
      depth = Math.max(0, depth - 1);
      if (depth === 0) over.value = false;
    };
    const drop = (event: DragEvent) => {
      if (!hasFiles(event)) return;
      event.preventDefault();
      depth = 0;
      over.value = false;
      const files: File[] = [];
      for (const item of event.dataTransfer!.items) {
        const entry = item.webkitGetAsEntry();
        const file = item.getAsFile();
        if (entry?.isDirectory) refuseFolder(entry.name);
        else if (file !== null) files.push(file);
      }
      if (files.length > 0) takeFiles(files);
    };
    const listeners = { dragenter: enter, dragover: move, dragleave: leave, drop } as const;
    const entries = Object.entries(listeners) as ["dragenter", (event: DragEvent) => void][];
    for (const [name, listener] of entries) addEventListener(name, listener);
    return () => {
      for (const [name, listener] of entries) removeEventListener(name, listener);
    };
  }, []);
  if (!over.value) return null;
  return (
    <div class="drop" aria-hidden="true" data-testid="drop">
      <div>
        <h2>Drop it here</h2>
        <p>
          <strong>GLB, OBJ, PLY</strong> A mesh is lit with its own shadows
        </p>
        <p>
          <strong>EXR, HDR</strong> A lat-long map becomes a stream of light
        </p>
      </div>
    </div>
  );
}
