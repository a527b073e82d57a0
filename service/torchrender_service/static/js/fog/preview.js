// The picture that the service makes of the photo as marks and sliders are: one question at a time, the newest wins.

import { ServiceError, request } from "../stream.js";

const SIDE = 640; // pixels of the longer side of a preview
const PATIENCE = 120_000; // ms

export class Preview {
  /**
   * `state()` gives the body of POST /v1/fog, or null if there is nothing to ask. Handlers: `picture(url)`,
   * `facts(facts)`, `said(warnings)`, `busy(flag)`, `failed(error)`.
   */
  constructor(state, handlers) {
    this.state = state;
    this.handlers = handlers;
    this.key = null;
    this.wanted = false;
    this.running = false;
    this.known = null; // marks of which facts are known
    this.stats = { asked: 0, shown: 0, errors: 0, latency_ms: null, server_ms: null };
  }

  /** Something changed. */
  ask() {
    this.wanted = true;
    if (!this.running) this.run();
  }

  get idle() {
    return !this.running && !this.wanted;
  }

  async run() {
    this.running = true;
    while (this.wanted) {
      this.wanted = false;
      const body = this.state();
      if (!body) {
        this.handlers.picture(null);
        continue;
      }
      try {
        await this.once({ side: SIDE, ...body });
      } catch (error) {
        if (this.wanted && !(error instanceof ServiceError)) continue;
        this.stats.errors++;
        this.handlers.failed(error);
      }
    }
    this.running = false;
    this.handlers.busy(false);
  }

  async once(body) {
    const begin = performance.now();
    this.stats.asked++;
    const marks = JSON.stringify(body.marks);
    if (marks !== this.known?.marks) this.handlers.busy(true);
    const response = await this.send(body, "image/jpeg");
    const url = URL.createObjectURL(await response.blob());
    await this.handlers.picture(url);
    const now = performance.now() - begin;
    this.stats.latency_ms = now;
    this.stats.server_ms = Number(/all;dur=([\d.]+)/.exec(response.headers.get("Server-Timing") ?? "")?.[1] ?? NaN);
    this.stats.shown++;
    this.handlers.said(JSON.parse(response.headers.get("Torchrender-Warnings") ?? "[]"));
    if (marks === this.known?.marks || this.wanted) return;
    const { facts } = await (await this.send(body, "application/json")).json();
    this.known = { marks, facts };
    this.handlers.facts(facts);
  }

  /** POST /v1/fog; errors tell the problem's detail. */
  async send(body, accept) {
    const headers = { Accept: accept, "Content-Type": "application/json" };
    if (this.key) headers.Authorization = `Bearer ${this.key}`;
    const response = await fetch("v1/fog", { method: "POST", body: JSON.stringify(body), headers, signal: AbortSignal.timeout(PATIENCE) });
    if (response.ok) return response;
    const problem = await response.json().catch(() => ({}));
    throw new ServiceError(response.status, problem.detail ?? problem.title ?? response.statusText);
  }

  /** The whole picture as a PNG. */
  async full() {
    const body = this.state();
    return body ? (await this.send(body, "image/png")).blob() : null;
  }
}

/** Send a photo; returns its id and size. */
export function sendPhoto(blob, key) {
  return request("v1/photos", { key, method: "POST", body: blob, headers: { "Content-Type": blob.type }, patience: PATIENCE });
}

/** Regions of a photo by strokes. */
export function divide(photo, body, key) {
  return request(`v1/photos/${photo}/regions`, {
    key, method: "POST", body: JSON.stringify(body), headers: { "Content-Type": "application/json" }, patience: PATIENCE,
  });
}

/** The text of a file of marks as another kind, checked: `from` and `to` are json or toml. */
export async function converted(text, from, to, key) {
  const headers = { Accept: `application/${to}`, "Content-Type": `application/${from}` };
  if (key) headers.Authorization = `Bearer ${key}`;
  const response = await fetch("v1/marks", { method: "POST", body: text, headers, signal: AbortSignal.timeout(PATIENCE) });
  if (response.ok) return response.text();
  const problem = await response.json().catch(() => ({}));
  throw new ServiceError(response.status, problem.detail ?? problem.title ?? response.statusText);
}
