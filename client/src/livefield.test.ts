import { encode } from "@msgpack/msgpack";
import { afterEach, describe, expect, it, vi } from "vitest";

import { LiveField, fieldUrl } from "./livefield.ts";

afterEach(() => vi.unstubAllGlobals());

class Socket {
  static readonly OPEN = 1;
  static newest: Socket;
  readonly readyState = Socket.OPEN;
  onmessage: (event: { data: Uint8Array }) => void = () => undefined;

  constructor(readonly url: string) {
    Socket.newest = this;
  }

  close(): void {}

  say(message: object): void {
    this.onmessage({ data: encode(message) });
  }
}

const member = (stream: string, problem = "") => ({ stream, state: problem === "" ? "running" : "stopped", problem });
const frame = (stream: string) => ({
  type: "frame",
  stream,
  coefficients: new Uint8Array(12),
  gradients: new Uint8Array(36),
  position: [1, 2, 3],
});

describe("a field", () => {
  it("has its address beside the page", () => {
    expect(fieldUrl("https://host/light/?token=t", "stage")).toBe("wss://host/light/api/v1/fields/stage/live?token=t&bands=5");
  });

  it("keeps the newest light of each stream that gives light", () => {
    vi.stubGlobal("WebSocket", Socket);
    const field = new LiveField("http://127.0.0.1:8400/");
    expect(field.state).toBe("idle");
    field.follow("stage");
    expect(Socket.newest.url).toContain("/fields/stage/live");
    Socket.newest.say({ type: "field_hello", heartbeat_seconds: 2, members: [member("left"), member("right")] });
    expect(field.state).toBe("waiting");
    Socket.newest.say(frame("left"));
    expect(field.lights.size).toBe(0); // the light of a part of the streams is another
    Socket.newest.say(frame("right"));
    expect(field.state).toBe("live");
    const before = field.lights;
    expect([...before.keys()]).toEqual(["left", "right"]);
    expect(field.lights.get("right")!.gradients).toHaveLength(9);
    Socket.newest.say({ type: "missed", stream: "left", count: 3, total: 3 });
    Socket.newest.say({ type: "field_status", members: [member("left", "it has stopped: start it"), member("right")] });
    expect([...field.lights.keys()]).toEqual(["right"]);
    expect([...before.keys()]).toEqual(["left", "right"]);
    expect(field.missed).toBe(3);
    // The server starts again: the last light stays until that of all is there.
    Socket.newest.say({ type: "field_hello", heartbeat_seconds: 2, members: [member("left", "no frame"), member("right", "no frame")] });
    expect([field.state, ...field.lights.keys()]).toEqual(["stalled", "right"]);
    Socket.newest.say({ type: "field_hello", heartbeat_seconds: 2, members: [member("left"), member("right")] });
    Socket.newest.say(frame("left"));
    expect([...field.lights.keys()]).toEqual(["right"]);
    Socket.newest.say(frame("right"));
    expect([...field.lights.keys()]).toEqual(["left", "right"]);
    field.follow("hall");
    expect([field.lights.size, field.members.length, field.missed]).toEqual([0, 0, 0]);
    field.follow(null);
    expect(field.state).toBe("idle");
  });
});
