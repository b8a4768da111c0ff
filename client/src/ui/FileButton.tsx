import type { ComponentChildren } from "preact";
import { useRef } from "preact/hooks";

interface Props {
  accept: string;
  onFiles: (files: File[]) => void;
  children: ComponentChildren;
}

/** A button that asks for files: for those who do not drag. */
export function FileButton({ accept, onFiles, children }: Props) {
  const input = useRef<HTMLInputElement>(null);
  return (
    <>
      <button type="button" onClick={() => input.current!.click()}>
        {children}
      </button>
      <input
        ref={input}
        type="file"
        multiple
        hidden
        accept={accept}
        aria-label="Files"
        onChange={(event) => {
          const files = [...(event.currentTarget.files ?? [])];
          event.currentTarget.value = ""; // so that the same file can be chosen again
          if (files.length > 0) onFiles(files);
        }}
      />
    </>
  );
}
