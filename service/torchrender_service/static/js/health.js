// How the picture and the server are: what is waited for, how old what is shown is, and whether anybody answers.

const SILENCE = 2500; // ms without a word from a server that says something every second
const LATE = 700; // ms that a picture may take before it is worth a word
const OLD = 3000; // ms from which on a picture is no live one
const KINDS = { moving: "a picture", still: "the refined picture", smooth: "smooth outlines" };

export class Health {
  constructor(client) {
    this.client = client;
    this.status = { doing: null, since_ms: 0, ahead: 0 };
    this.heardAt = 0;
    this.pending = null; // a change of settings whose picture is not there yet
  }

  /** A STATUS message. */
  hear(status) {
    this.status = status;
    this.heardAt = performance.now();
  }

  /** Settings were sent. */
  expect(seq, what) {
    const names = new Set([...(this.pending?.names ?? []), what]);
    this.pending = { seq, names, since: this.pending?.since ?? performance.now() };
  }

  /** A picture came. */
  arrived(header) {
    if (this.pending && (header.settings ?? 0) >= this.pending.seq) this.pending = null;
  }

  /** Milliseconds since anything came; null where no server is connected. */
  get silence() {
    const { state, stream } = this.client;
    return state === "live" && stream.heard ? performance.now() - stream.heard : null;
  }

  /** Milliseconds since the client asked for the picture that is shown; null: it is of this very view, fine or coarse. */
  get age() {
    const { keyframes, walker } = this.client;
    const newest = keyframes.newest?.header;
    if (!newest || !walker.camera) return null;
    const here = walker.camera.world_from_camera;
    const playing = !newest.still && newest.scene_s !== undefined;
    const current = !playing && newest.camera.world_from_camera.every((v, k) => Math.abs(v - here[k]) < 1e-6);
    return current && !this.pending ? null : performance.now() - newest.time_ms;
  }

  /** What is being made, in words. */
  kind(doing) {
    const bound = this.client.wishes?.max_error;
    return bound && doing === "still" ? `the picture within an error of ${bound}` : KINDS[doing];
  }

  /** What to say in the header: kind ("good", "busy" or "bad"), text and seconds; null: nothing beside the state. */
  get notice() {
    const { state, keyframes } = this.client;
    if (state !== "live") return null;
    if (this.silence > SILENCE) return { kind: "bad", text: "no answer", ms: this.silence };
    const { ahead, doing, since_ms } = this.status;
    const passed = since_ms + performance.now() - this.heardAt;
    if (ahead > 0) return { kind: "busy", text: `server busy: ${ahead} ahead` };
    if (this.pending && performance.now() - this.pending.since > LATE) {
      const ms = performance.now() - this.pending.since;
      return { kind: "busy", text: `waiting for ${[...this.pending.names].join(", ")}`, ms };
    }
    if (!keyframes.newest) return { kind: "busy", text: "first picture", ms: doing ? passed : undefined };
    const age = this.age;
    const old = age > OLD; // also where nobody has begun with another one
    if (doing && passed > LATE) return { kind: old ? "busy" : "good", text: `making ${this.kind(doing)}`, ms: passed };
    return old ? { kind: "busy", text: "picture is old", ms: age } : null;
  }
}
