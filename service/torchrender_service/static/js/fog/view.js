// The photo with its marks: moved and zoomed, marks dragged, strokes drawn; mouse, pen and touch.

const SVG = "http://www.w3.org/2000/svg";
const ZOOM = [0.2, 20]; // times the size that fits
const MARGIN = 0.86; // of the window that the photo takes at first: corners may lie outside of it
const HANDLE = 6; // CSS pixels
const REACH = 16; // CSS pixels around a handle that still grab it
const STEP = 3; // CSS pixels between points of a stroke
const LOUPE = 3; // times larger than the photo's pixels on the screen

const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
const svg = (name, attributes, parent) => {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) if (value != null) element.setAttribute(key, value);
  parent?.append(element);
  return element;
};
const text = (points) => points.map((p) => p.join(",")).join(" ");

export class View {
  /**
   * `stage` holds `paper` (the pictures) and `ink` (an SVG element for marks). Handlers: `grab()` before marks are
   * dragged, `move(path, place, handle)`, `drop()`, `insert(path, k, place)`, `select(path)`, `stroke(points)`.
   */
  constructor({ stage, paper, ink, loupe }, handlers) {
    Object.assign(this, { stage, paper, ink, loupe, handlers });
    this.layer = svg("g", {}, ink);
    this.size = [1, 1];
    this.fit();
    this.pointers = new Map();
    this.drag = null;
    this.brush = null; // class of the strokes that are drawn, null: marks are moved
    this.listen();
  }

  /** Show a photo of this size. */
  show(width, height, url) {
    this.size = [width, height];
    this.url = url;
    this.fit();
  }

  fit() {
    const { clientWidth: w, clientHeight: h } = this.stage;
    this.base = MARGIN * Math.min(w / this.size[0], h / this.size[1]) || 1;
    this.scale = this.base;
    this.shift = [(w - this.size[0] * this.scale) / 2, (h - this.size[1] * this.scale) / 2];
    this.place();
  }

  place() {
    const [x, y] = this.shift;
    this.paper.style.transform = `translate(${x}px, ${y}px) scale(${this.scale})`;
    this.paper.style.width = `${this.size[0]}px`;
    this.paper.style.height = `${this.size[1]}px`;
    this.layer.setAttribute("transform", `translate(${x} ${y}) scale(${this.scale})`);
    if (this.last) this.draw(this.last);
  }

  /** Pixel of the photo at a place of the window. */
  toPhoto(clientX, clientY) {
    const box = this.stage.getBoundingClientRect();
    return [(clientX - box.left - this.shift[0]) / this.scale, (clientY - box.top - this.shift[1]) / this.scale];
  }

  /** Place of the window where a pixel of the photo is shown. */
  toClient([x, y]) {
    const box = this.stage.getBoundingClientRect();
    return [box.left + this.shift[0] + x * this.scale, box.top + this.shift[1] + y * this.scale];
  }

  /** The photo's pixel in the middle of what is shown, within the photo. */
  get middle() {
    const box = this.stage.getBoundingClientRect();
    const place = this.toPhoto(box.left + box.width / 2, box.top + box.height / 2);
    return place.map((v, k) => clamp(v, 0.25 * this.size[k], 0.75 * this.size[k]));
  }

  zoom(factor, clientX, clientY) {
    const box = this.stage.getBoundingClientRect();
    const at = [clientX - box.left, clientY - box.top];
    const next = clamp(this.scale * factor, ZOOM[0] * this.base, ZOOM[1] * this.base);
    this.shift = this.shift.map((v, k) => at[k] - ((at[k] - v) * next) / this.scale);
    this.scale = next;
    this.place();
  }

  pan(dx, dy) {
    this.shift = [this.shift[0] + dx, this.shift[1] + dy];
    this.place();
  }

  // ------------------------------------------------------------------------------- drawing

  /** Draw shapes; `selected` is a path, `fitted` lines of the room that the service found, `strokes` what was painted. */
  draw({ shapes, selected, fitted = [], strokes = [] }) {
    this.last = { shapes, selected, fitted, strokes };
    this.layer.replaceChildren();
    const px = 1 / this.scale;
    for (const { points, width, kind } of strokes)
      svg("polyline", { points: text(points.length > 1 ? points : [points[0], points[0]]), class: `stroke ${kind}`, "stroke-width": width }, this.layer);
    const chosen = (path) => selected && path.every((key, k) => selected[k] === key);
    for (const shape of shapes) {
      const on = chosen(shape.path) || (selected && selected[0] === shape.path[0] && selected[1] === shape.path[1]);
      const group = svg("g", { class: `mark ${shape.kind}${on ? " on" : ""}` }, this.layer);
      if (shape.closed) svg("polygon", { points: text(shape.points), "data-shape": JSON.stringify(shape.path) }, group);
      for (const line of shape.lines) svg("polyline", { points: text(line) }, group);
      if (this.brush || (shape.kind !== "room" && shape.handles.length > 12 && !on)) continue;
      if (on && shape.closed) this.middles(shape, group, px);
      for (const handle of shape.handles) this.handle(handle, shape, group, px, selected);
    }
    for (const line of fitted) svg("polyline", { points: text(line), class: "fitted" }, this.layer);
  }

  handle({ place, path, title }, shape, group, px, selected) {
    const [cx, cy] = place;
    const own = JSON.stringify(path) === JSON.stringify(selected) ? " own" : "";
    const dot = svg("circle", { cx, cy, r: HANDLE * px, class: `handle${own}` }, group);
    const reach = svg("circle", { cx, cy, r: REACH * px, class: "reach", "data-handle": JSON.stringify(path) }, group);
    svg("title", {}, reach).textContent = title ?? shape.name;
    return dot;
  }

  /** Small handles between corners: dragging one makes a corner. */
  middles(shape, group, px) {
    shape.points.forEach(([x, y], k) => {
      const [u, v] = shape.points[(k + 1) % shape.points.length];
      const apart = Math.hypot(u - x, v - y) / px;
      if (apart < 3 * REACH) return;
      const [cx, cy] = [(x + u) / 2, (y + v) / 2];
      svg("circle", { cx, cy, r: 3.5 * px, class: "middle" }, group);
      svg("circle", { cx, cy, r: 0.7 * REACH * px, class: "reach", "data-middle": JSON.stringify([shape.path, k]) }, group);
    });
  }

  // ------------------------------------------------------------------------------ pointers

  listen() {
    const { stage } = this;
    stage.addEventListener("pointerdown", (event) => this.down(event));
    stage.addEventListener("pointermove", (event) => this.moved(event));
    for (const name of ["pointerup", "pointercancel"]) stage.addEventListener(name, (event) => this.up(event));
    const wheel = (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY * (event.ctrlKey ? 0.01 : 0.0015)), event.clientX, event.clientY);
    };
    stage.addEventListener("wheel", wheel, { passive: false });
  }

  down(event) {
    if (event.button > 1) return;
    event.preventDefault();
    document.activeElement?.blur?.();
    this.stage.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (this.pointers.size > 1) {
      this.finish(true); // a second finger zooms
      return;
    }
    const place = this.toPhoto(event.clientX, event.clientY);
    if (this.brush && event.button === 0) {
      this.drag = { kind: "stroke", points: [place] };
      this.drag.line = svg("polyline", { points: text([place, place]), class: `stroke ${this.brush.kind}`, "stroke-width": this.brush.width / this.scale }, this.layer);
      return;
    }
    this.drag = event.button === 0 ? this.grabbed(event.target, place) : { kind: "pan" };
  }

  grabbed(target, place) {
    const { handle, middle, shape } = target.dataset;
    if (middle) {
      const [path, k] = JSON.parse(middle);
      this.handlers.grab();
      this.handlers.insert(path, k, place);
      return { kind: "handle", path: [...path, k + 1], offset: [0, 0] };
    }
    if (handle) {
      const path = JSON.parse(handle);
      const found = this.last.shapes.flatMap((s) => s.handles).find((h) => JSON.stringify(h.path) === handle);
      this.handlers.select(path);
      return { kind: "handle", path, row: found?.row, offset: found ? found.place.map((v, k) => v - place[k]) : [0, 0], grab: true };
    }
    if (shape) {
      const path = JSON.parse(shape);
      this.handlers.select(path);
      const found = this.last.shapes.find((s) => JSON.stringify(s.path) === shape);
      return { kind: "shape", start: place, before: found.handles.map((h) => [h.path, h.place]), grab: true };
    }
    return { kind: "pan", still: true };
  }

  moved(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    this.pointers.set(event.pointerId, now);
    if (this.pointers.size === 2) return this.pinch(event.pointerId, before, now);
    const { drag } = this;
    if (!drag) return;
    if (drag.grab) {
      this.handlers.grab();
      drag.grab = false;
    }
    const place = this.toPhoto(...now);
    if (drag.kind === "pan") {
      drag.still = false;
      this.pan(now[0] - before[0], now[1] - before[1]);
    } else if (drag.kind === "handle") {
      const to = place.map((v, k) => v + drag.offset[k]);
      this.handlers.move([[drag.path, drag.row ? to[1] : to]]);
      this.magnify(to, event);
    } else if (drag.kind === "shape") {
      const by = place.map((v, k) => v - drag.start[k]);
      this.handlers.move(drag.before.map(([path, at]) => [path, at.map((v, k) => v + by[k])]));
    } else if (drag.kind === "stroke") {
      const last = drag.points.at(-1);
      if (Math.hypot(place[0] - last[0], place[1] - last[1]) * this.scale < STEP) return;
      drag.points.push(place);
      drag.line.setAttribute("points", text(drag.points));
    }
  }

  pinch(id, before, now) {
    const [other] = [...this.pointers].filter(([key]) => key !== id).map(([, place]) => place);
    const apart = (p) => Math.max(1, Math.hypot(p[0] - other[0], p[1] - other[1]));
    this.zoom(apart(now) / apart(before), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    this.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
  }

  up(event) {
    if (!this.pointers.delete(event.pointerId)) return;
    if (!this.pointers.size) this.finish(event.type === "pointercancel");
  }

  finish(cancelled) {
    const { drag } = this;
    this.drag = null;
    this.loupe.hidden = true;
    if (!drag) return;
    if (drag.kind === "stroke") {
      drag.line.remove();
      if (!cancelled || drag.points.length > 8) this.handlers.stroke(drag.points, this.brush.width / this.scale);
    } else if (drag.kind === "pan") {
      if (drag.still && !cancelled) this.handlers.select(null);
    } else if (!drag.grab) this.handlers.drop();
  }

  /** What a finger hides, enlarged beside it. */
  magnify([x, y], event) {
    const coarse = event.pointerType === "touch";
    this.loupe.hidden = !coarse;
    if (!coarse) return;
    const scale = LOUPE * this.scale;
    const half = 48;
    const box = this.stage.getBoundingClientRect();
    this.loupe.style.backgroundImage = `url("${this.url}")`;
    this.loupe.style.backgroundSize = `${this.size[0] * scale}px ${this.size[1] * scale}px`;
    this.loupe.style.backgroundPosition = `${half - x * scale}px ${half - y * scale}px`;
    this.loupe.dataset.side = event.clientX - box.left < box.width / 2 ? "right" : "left";
  }
}
