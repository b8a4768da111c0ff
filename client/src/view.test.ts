import { describe, expect, it } from "vitest";

import { DEFAULT_VIEW, formatView, parseView, type View } from "./view.ts";

const CHANGED: View = {
  stream: "room & board",
  light: "both",
  field: "stage",
  grid: "0b5c1e-7.grid-16x16x16",
  groups: ["0b5c1e-8.grid", "0b5c1e-9.adaptive"],
  gradients: false,
  probeAt: [0.5, 0, -1.25],
  object: "0b5c1e-8",
  at: [0.25, -1.5, 2],
  size: "true",
  radius: 0.4,
  gizmo: true,
  probeGizmo: true,
  sliceAxis: "x",
  slice: 0.125,
  probes: false,
  sampling: "fragment",
  ev: -1.25,
  camera: [1.5, -4.25, 2, 0, 0.125, 0.6],
  colour: "#aa3366",
  gloss: 0.75,
  exponent: 12.5,
  mirror: 0.4,
  shadows: false,
  bands: 3,
  backdrop: "harmonics",
  arrow: true,
  panel: false,
  tab: "jobs",
  jobState: "failed",
  jobKind: "ilf-grid",
  hud: false,
  theme: "light",
};

describe("the view in the address", () => {
  it("is empty for the default", () => {
    expect(formatView(DEFAULT_VIEW)).toBe("");
    expect(parseView("")).toEqual(DEFAULT_VIEW);
  });

  it("comes back as it was written", () => {
    expect(parseView(formatView(CHANGED))).toEqual(CHANGED);
  });

  it("keeps the default where the address makes no sense", () => {
    const hash = "#ev=bright&camera=1,2&colour=red&gloss=7&bands=9&backdrop=sky&shadows=maybe&exponent=&other=1";
    const objects = "#object=../x&grid=a/b&at=1,,2&light=sun&slice=2&sliceAxis=w&sampling=no&mirror=-1&tab=none&size=7&jobState=lost&jobKind=a b&groups=a,../b&gradients=2&probeAt=1&radius=9&field=../x";
    expect(parseView(objects)).toEqual(DEFAULT_VIEW);
    expect(parseView(hash)).toEqual(DEFAULT_VIEW);
    expect(parseView("#groups=a,b,c,d").groups).toEqual([]); // with the grid itself more than are drawn
    expect(parseView("#groups=a,b,a").groups).toEqual(["a", "b"]);
  });
});
