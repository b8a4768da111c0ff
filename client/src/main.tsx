import { render } from "preact";

import "./style.css";
import { App } from "./ui/App.tsx";
import { bindViewToAddress } from "./view.ts";

bindViewToAddress();
render(<App />, document.getElementById("page")!);
