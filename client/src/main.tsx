import { render } from "preact";

import "./style.css";
import { App } from "./ui/App.tsx";
import { bindViewToAddress } from "./view.ts";

bindViewToAddress();
const page = document.getElementById("page")!;
// What index.html shows is painted first: making the graphics takes the thread for a while.
requestAnimationFrame(() =>
  setTimeout(() => {
    page.replaceChildren();
    render(<App />, page);
  }),
);
