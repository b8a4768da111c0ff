import { signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";

interface Picture {
  title: string;
  url: string;
}

const picture = signal<Picture | null>(null);

export function showPicture(title: string, url: string): void {
  picture.value = { title, url };
}

/** A picture of the server, as large as the window allows. */
export function PictureDialog() {
  const dialog = useRef<HTMLDialogElement>(null);
  const shown = picture.value;
  useEffect(() => {
    if (shown !== null && dialog.current?.open === false) dialog.current.showModal();
  }, [shown]);
  if (shown === null) return null;
  return (
    <dialog class="help large" ref={dialog} aria-labelledby="picture-title" onClose={() => (picture.value = null)}>
      <header>
        <h2 id="picture-title">{shown.title}</h2>
        <form method="dialog" class="buttons">
          <button type="submit">Close</button>
          <a href={shown.url} target="_blank" rel="noreferrer">
            Open in a tab
          </a>
        </form>
      </header>
      <img src={shown.url} alt={shown.title} />
    </dialog>
  );
}
