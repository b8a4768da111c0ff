import { describe, expect, it } from "vitest";

import { add, arrivals, find, forget, newArrival, recall, update } from "./arrivals.ts";

class Kept implements Pick<Storage, "getItem" | "setItem"> {
  text: string | null = null;
  getItem = () => this.text;
  setItem = (_: string, value: string) => void (this.text = value);
}

describe("files on their way", () => {
  it("outlive a reload, but for what is in the picture", () => {
    const kept = new Kept();
    expect(recall(kept as unknown as Storage)).toEqual([]);
    const [running, shown, refused] = [
      newArrival("a.glb", "mesh"),
      newArrival("b.glb", "mesh", { phase: "ready", shown: true }),
      newArrival("c.txt", "mesh", { phase: "failed", problem: "This is no mesh." }),
    ];
    add([running, shown, refused]);
    update(running.key, { phase: "computing", job: "17" });
    expect(find(running.key)!.job).toBe("17");
    const again = new Kept();
    again.text = kept.text;
    const unfinished = recall(again as unknown as Storage);
    expect(unfinished.map(({ name, job }) => [name, job])).toEqual([["a.glb", "17"]]);
    expect(arrivals.value.map(({ name }) => name)).toEqual(["a.glb", "c.txt"]);
    forget(running.key);
    expect(JSON.parse(again.text!)).toHaveLength(1);
  });

  it("are forgotten where the browser keeps nothing", () => {
    const broken = { getItem: () => "{", setItem: () => { throw new Error("full"); } };
    expect(recall(broken as unknown as Storage)).toEqual([]);
    add([newArrival("a.glb", "mesh")]);
    expect(arrivals.value).toHaveLength(1);
  });
});
