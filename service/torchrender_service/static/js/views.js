// Where to look from: named cameras, how to move, taking views elsewhere, and what a click shows.

import { commandText, pythonText } from "./address.js";

const $ = (id) => document.getElementById(id);
const CLICK_PIXELS = 4; // a pointer that moves farther drags
const CLICK_MS = 400;
const SHOWN_MS = 8000; // a found surface
const TOLD_MS = 1600; // that something was copied

async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    // Pages over plain HTTP from another machine have no clipboard of their own.
    const area = document.createElement("textarea");
    area.value = text;
    document.body.append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
}

export class Views {
  /** `client`; `name()` of the scene for Python, `settings`, `changed()` after the view or the way to move did. */
  constructor({ client, name, settings, changed, link }) {
    this.client = client;
    this.changed = changed;
    this.cameras = {};
    $("home").addEventListener("click", () => this.go(client.walker.home));
    $("cameras").addEventListener("change", () => {
      this.go(this.cameras[$("cameras").value] ?? client.walker.home);
    });
    for (const input of document.querySelectorAll("input[name=controls]"))
      input.addEventListener("change", () => {
        client.walker.setMode(input.value);
        this.showMode();
        changed();
      });
    const look = () => ({ ev: settings.ev, tone: settings.message().tone_map });
    this.copies("copy-link", link);
    this.copies("copy-python", () => pythonText(client.walker, name(), look()));
    this.copies("copy-command", () => commandText(client.walker, name(), look()));
    this.listen();
  }

  copies(id, text) {
    const button = $(id);
    const label = button.textContent;
    button.addEventListener("click", async () => {
      if (!this.client.walker.camera) return;
      await copy(text());
      button.textContent = "copied";
      setTimeout(() => (button.textContent = label), TOLD_MS);
    });
  }

  go(camera) {
    const { walker } = this.client;
    if (!camera || !walker.camera) return;
    walker.jumpTo(camera);
    this.client.dirty = true;
    this.changed();
  }

  /** A scene's cameras by name. */
  showCameras(cameras) {
    this.cameras = cameras;
    const names = Object.keys(cameras);
    $("cameras").replaceChildren(...names.map((name) => new Option(name.replaceAll("_", " "), name)));
    $("cameras").disabled = names.length < 2;
  }

  showMode() {
    const { mode } = this.client.walker;
    for (const input of document.querySelectorAll("input[name=controls]")) input.checked = input.value === mode;
    document.body.dataset.controls = mode;
  }

  /** Clicks ask what is there; a double click in orbit turns about it. */
  listen() {
    const { stage } = this.client.walker;
    let begun = null;
    stage.addEventListener("pointerdown", (event) => {
      begun = event.isPrimary && event.button === 0 ? { x: event.clientX, y: event.clientY, at: performance.now() } : null;
    });
    stage.addEventListener("pointerup", (event) => {
      const far = begun ? Math.hypot(event.clientX - begun.x, event.clientY - begun.y) : Infinity;
      if (far > CLICK_PIXELS || performance.now() - begun.at > CLICK_MS) return;
      this.pick(event);
    });
    stage.addEventListener("dblclick", (event) => {
      this.turn = true;
      this.pick(event);
    });
  }

  pick(event) {
    const box = this.client.walker.stage.getBoundingClientRect();
    this.client.pick(event.clientX - box.left, event.clientY - box.top);
  }

  showPicked(found) {
    const there = found.triangle >= 0;
    const { walker } = this.client;
    if (this.turn && there && walker.orbiting) {
      walker.orbitAbout(found.point);
      this.client.dirty = true;
    }
    this.turn = false;
    const zero = 1e-6 * this.client.diagonal;
    const numbers = (v) => v.map((x) => (Math.abs(x) < zero ? "0" : x.toPrecision(4))).join(", ");
    $("picked").hidden = false;
    $("picked").textContent = there
      ? `${found.name || "unnamed"} · ${found.material || "no material"} · triangle ${found.face} · (${numbers(found.point)})`
      : "nothing there";
    clearTimeout(this.timer);
    this.timer = setTimeout(() => ($("picked").hidden = true), SHOWN_MS);
  }
}
