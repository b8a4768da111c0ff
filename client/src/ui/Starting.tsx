/** What index.html shows until the script runs, and the page until the picture is there. */
export function Starting() {
  return (
    <aside class="panel closed" aria-label="Lightwell">
      <header>
        <h1>Lightwell</h1>
        <span class="badge quiet">Starting</span>
      </header>
    </aside>
  );
}
