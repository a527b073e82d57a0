// The connection to the server: sessions over REST, the stream over a WebSocket, and coming back after a break.

import { PROTOCOL, TYPE, decodeMessage, encodeMessage } from "./wire.js";

const FIRST_WAIT = 0.4; // seconds
const LONGEST_WAIT = 5;
const OPEN_TIMEOUT = 8000; // ms until WELCOME
const PATIENCE = 60_000; // ms for an answer: a scene that is not loaded yet takes seconds, a lost request for ever
const MAX_BUFFERED = 65536; // bytes that wait in the socket: then poses are left out, newer ones follow anyway

export class ServiceError extends Error {
  constructor(status, detail, retryAfter) {
    super(detail);
    this.status = status;
    this.retryAfter = retryAfter;
  }
}

/** JSON of a request to the service; an error tells the problem document's detail. */
export async function request(path, { key, patience = PATIENCE, ...options } = {}) {
  const headers = { Accept: "application/json", ...options.headers };
  if (key) headers.Authorization = `Bearer ${key}`;
  const response = await fetch(path, { ...options, headers, signal: AbortSignal.timeout(patience) });
  const body = await response.json().catch(() => ({}));
  if (!response.ok) {
    const wait = Number(response.headers.get("Retry-After"));
    throw new ServiceError(response.status, body.detail ?? body.title ?? response.statusText, wait || undefined);
  }
  return body;
}

/** A session of the service; `wishes` is the body of POST /v1/sessions. */
export function askSession(wishes, key) {
  const headers = { "Content-Type": "application/json" };
  return request("v1/sessions", { method: "POST", headers, body: JSON.stringify(wishes), key });
}

/**
 * Keeps a stream open. Handlers: `state(name, detail)` with connecting, live, waiting, failed or closed;
 * `welcome(header, session)`; `keyframe(buffer)`; `problem(header)`; `told(type, header)` for what a viewer is told.
 */
export class Stream {
  constructor(handlers) {
    this.handlers = handlers;
    this.socket = null;
    this.generation = 0;
    this.connections = 0;
    window.addEventListener("online", () => this.wake?.());
  }

  /** Open a session with the body of POST /v1/sessions; an earlier one ends. `asked`: the answer is on its way. */
  start(wishes, key, asked = null) {
    this.stop();
    this.asked = asked;
    this.resume = null;
    this.session = null;
    this.wishes = wishes;
    this.key = key;
    this.run(++this.generation);
  }

  stop() {
    this.generation++;
    this.wake?.();
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(encodeMessage(TYPE.BYE, { reason: "left" }));
    this.socket?.close();
    this.socket = null;
    this.handlers.state("closed");
  }

  send(type, header, { droppable = false } = {}) {
    if (this.socket?.readyState !== WebSocket.OPEN || !this.welcomed) return false;
    if (droppable && this.socket.bufferedAmount > MAX_BUFFERED) return false;
    this.socket.send(encodeMessage(type, header));
    return true;
  }

  async run(generation) {
    let wait = FIRST_WAIT;
    while (generation === this.generation) {
      this.retryAfter = 0;
      try {
        this.handlers.state("connecting");
        const ticket = this.resume ?? (await this.openSession());
        this.resume = null; // a ticket works once
        if (generation !== this.generation) return;
        if (await this.listen(ticket, generation)) wait = FIRST_WAIT;
      } catch (error) {
        if (generation !== this.generation) return;
        const fatal = error instanceof ServiceError && error.status >= 400 && error.status < 500 && error.status !== 429;
        if (fatal) return this.handlers.state("failed", error);
        this.retryAfter = error.retryAfter ?? 0;
        this.reason = error.message;
      }
      if (generation !== this.generation) return;
      const pause = Math.max(this.retryAfter, wait * (0.8 + 0.4 * Math.random()));
      wait = Math.min(LONGEST_WAIT, wait * 1.7);
      this.handlers.state("waiting", { seconds: pause, reason: this.reason });
      await new Promise((wake) => {
        this.wake = wake;
        setTimeout(wake, 1000 * pause);
      });
    }
  }

  async openSession() {
    const { asked } = this;
    this.asked = null;
    const session = await (asked ?? askSession(this.wishes, this.key));
    this.session = session;
    return session.ticket;
  }

  /** One connection from opening to its end; tells whether it got as far as WELCOME. */
  listen(ticket, generation) {
    // Beside the page, wherever a proxy shows it.
    const address = new URL(this.session.stream.replace(/^\//, ""), document.baseURI);
    address.protocol = address.protocol.replace("http", "ws");
    const socket = new WebSocket(address, [PROTOCOL, `bearer.${ticket}`]);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.welcomed = false;
    const timer = setTimeout(() => !this.welcomed && socket.close(), OPEN_TIMEOUT);
    socket.onopen = () => {
      const layers = this.wishes.layers;
      const images = { depth: ["pz1"], color: ["jpeg", "webp"], max_pixels: MAX_PIXELS, mirrors: true };
      const hello = { versions: [1, 1], ...images, layers, viewer: true };
      socket.send(encodeMessage(TYPE.HELLO, hello));
    };
    socket.onmessage = ({ data }) => generation === this.generation && this.receive(data);
    return new Promise((done) => {
      socket.onclose = ({ code, reason }) => {
        clearTimeout(timer);
        const welcomed = this.welcomed;
        if (this.socket === socket) this.welcomed = false;
        this.reason = reason || (welcomed ? "connection lost" : `not reached (${code})`);
        done(welcomed);
      };
    });
  }

  receive(buffer) {
    this.heard = performance.now();
    // KEYFRAME headers are read by the decode worker, with its checks: only the type is looked at here.
    if (buffer.byteLength > 5 && new Uint8Array(buffer, 5, 1)[0] === TYPE.KEYFRAME) return this.handlers.keyframe(buffer);
    const { type, header } = decodeMessage(buffer);
    if (type === TYPE.WELCOME) {
      this.welcomed = true;
      this.heard = performance.now();
      this.connections++;
      this.resume = header.resume;
      this.handlers.state("live");
      this.handlers.welcome(header, this.session);
    } else if (type === TYPE.ERROR) this.handlers.problem(header);
    else if (type === TYPE.STATUS || type === TYPE.LOOK || type === TYPE.PICKED) this.handlers.told(type, header);
    else if (type === TYPE.BYE) {
      this.retryAfter = header.retry_after_s ?? 0;
      this.reason = header.reason;
    }
  }
}

/** The largest picture that the client takes, overscan included. */
export const MAX_PIXELS = 4096 * 2304;
