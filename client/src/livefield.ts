// A live subscription of a field: the newest light of each of its streams. The viewport and the panel come and look.

import { decode } from "@msgpack/msgpack";

import { Connection, socketUrl } from "./connection.ts";
import { lightOf, looksTheSame, type ConnectionState, type Light } from "./live.ts";
import { Rate } from "./rate.ts";
import { PAGE_BANDS } from "./sh.ts";
import type { FieldMember, FieldMessage } from "./wire.ts";

/** Where the subscription of a field lives, beside the page. */
export function fieldUrl(base: string, field: string): string {
  return socketUrl(base, `fields/${encodeURIComponent(field)}/live`, { bands: String(PAGE_BANDS) });
}

/** Whether the lights of a field look the same: then there is nothing to draw. */
export function lookTheSame(a: ReadonlyMap<string, Light>, b: ReadonlyMap<string, Light>): boolean {
  if (a.size !== b.size) return false;
  return [...a].every(([stream, light]) => {
    const other = b.get(stream);
    return other !== undefined && looksTheSame(light, other);
  });
}

export class LiveField {
  /**
   * The newest light of each stream that gives light. Replaced as it changes: what was read stays as it was. It also
   * stays while no stream gives any, and while the first of a stream is on its way: that of a part would be another.
   */
  lights: ReadonlyMap<string, Light> = new Map();
  /** The streams of the field, and why some give no light. */
  members: readonly FieldMember[] = [];
  /** Frames that the server overtook for this page. */
  missed = 0;
  readonly frames = new Rate();

  private field: string | null = null;
  private newest = new Map<string, Light>();
  private readonly connection = new Connection((data, receivedMs) => this.receive(data, receivedMs));

  constructor(private readonly base: string) {}

  /** Follow this field from now on, or none; what was known of another one is forgotten. */
  follow(field: string | null): void {
    if (field === this.field && !this.connection.refused) return;
    this.field = field;
    this.lights = new Map();
    this.newest.clear();
    this.members = [];
    this.missed = 0;
    this.frames.clear();
    if (field === null) this.connection.close();
    else this.connection.open(() => fieldUrl(this.base, field));
  }

  retry(): void {
    this.connection.retry();
  }

  /** Why the connection is refused or lost, in words. */
  get problem(): string {
    return this.connection.problem;
  }

  get state(): ConnectionState {
    if (this.field === null) return "idle";
    if (this.connection.refused) return "refused";
    if (this.connection.isRetrying) return "retrying";
    if (!this.connection.isOpen) return "connecting";
    if (this.lights.size === 0) return "waiting";
    return this.members.every(({ state }) => state !== "running") ? "stalled" : "live";
  }

  private receive(data: ArrayBuffer, receivedMs: number): void {
    const message = decode(new Uint8Array(data)) as FieldMessage;
    switch (message.type) {
      case "field_hello":
        this.connection.established(message.heartbeat_seconds);
        this.newest.clear();
        this.keep(message.members);
        break;
      case "field_status":
        this.keep(message.members);
        break;
      case "frame":
        this.newest.set(message.stream, lightOf(message, receivedMs));
        this.show();
        this.frames.add(receivedMs);
        break;
      case "missed":
        this.missed += message.count;
        break;
      case "heartbeat":
        break;
      case "refused":
        this.connection.refuse(message.reason);
        break;
    }
  }

  /** Leave out what gives no light any more. */
  private keep(members: readonly FieldMember[]): void {
    this.members = members;
    const given = new Set(this.giving());
    this.newest = new Map([...this.newest].filter(([stream]) => given.has(stream)));
    this.show();
  }

  private giving(): string[] {
    return this.members.filter(({ problem }) => problem === "").map(({ stream }) => stream);
  }

  private show(): void {
    const giving = this.giving();
    if (giving.length > 0 && giving.every((stream) => this.newest.has(stream))) this.lights = new Map(this.newest);
  }
}
