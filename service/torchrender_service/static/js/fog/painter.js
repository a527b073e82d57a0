// Labels by a few strokes: parts of a photo, each with its colour and what it is.

const MOST_THINGS = 8;
const BRUSH = 12; // CSS pixels

export class Painter {
  /** `bar` gets a button for each part. Handlers: `brush(brush)` when another part is chosen, `divide(body)`. */
  constructor(bar, handlers) {
    this.bar = bar;
    this.handlers = handlers;
    this.clear();
  }

  clear() {
    this.parts = [{ label: "ground" }, { label: "vertical" }, { label: "sky" }];
    this.strokes = [];
    this.part = 0;
    this.show();
  }

  kind(part) {
    const { label } = this.parts[part];
    return label === "vertical" ? `vertical t${this.parts.slice(0, part).filter((p) => p.label === "vertical").length}` : label;
  }

  get brush() {
    return { kind: this.kind(this.part), width: BRUSH };
  }

  /** Strokes as the view draws them. */
  get drawn() {
    return this.strokes.map(({ part, points, width }) => ({ points, width, kind: this.kind(part) }));
  }

  choose(part) {
    this.part = part;
    this.show();
    this.handlers.brush(this.brush);
  }

  add(points, width) {
    const wide = Math.min(1000, Math.max(1, width));
    this.strokes.push({ part: this.part, points: points.map((p) => p.map((v) => Math.round(10 * v) / 10)), width: wide });
    this.send();
  }

  takeBack() {
    this.strokes.pop();
    this.send();
  }

  send() {
    this.show();
    const used = [...new Set(this.strokes.map((s) => s.part))].sort((a, b) => a - b);
    if (used.length < 2) return;
    const parts = used.map((part) => this.parts[part]);
    const strokes = this.strokes.map((s) => ({ ...s, part: used.indexOf(s.part), points: s.points.slice(0, 4096) }));
    this.handlers.divide({ parts, strokes });
  }

  show() {
    const used = new Set(this.strokes.map((s) => s.part));
    const names = this.parts.map(({ label }, part) => {
      const things = this.parts.slice(0, part + 1).filter((p) => p.label === "vertical").length;
      return label === "vertical" ? `thing ${things}` : label;
    });
    const buttons = names.map((name, part) => {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: name });
      if (name.startsWith("thing")) button.title = "what stands at one distance";
      button.className = `chip ${this.kind(part)}`;
      button.setAttribute("aria-pressed", String(part === this.part));
      if (used.has(part)) button.classList.add("used");
      button.addEventListener("click", () => this.choose(part));
      return button;
    });
    const more = Object.assign(document.createElement("button"), { type: "button", textContent: "+ thing", title: "another standing thing, at another distance" });
    more.disabled = this.parts.length - 2 >= MOST_THINGS;
    more.addEventListener("click", () => this.parts.push({ label: "vertical" }) && this.choose(this.parts.length - 1));
    const back = Object.assign(document.createElement("button"), { type: "button", textContent: "Undo stroke" });
    back.disabled = !this.strokes.length;
    back.addEventListener("click", () => this.takeBack());
    const clear = Object.assign(document.createElement("button"), { type: "button", textContent: "Clear strokes" });
    clear.disabled = !this.strokes.length;
    clear.addEventListener("click", () => {
      this.clear();
      this.handlers.brush(this.brush);
    });
    this.bar.replaceChildren(...buttons, more, back, clear);
  }
}
