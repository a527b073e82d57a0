// What the user wishes for: the inputs of the panel, as messages to the server and as words of the address.

const $ = (id) => document.getElementById(id);
const BUDGET = [15, 2000]; // ms, ends of the logarithmic slider
const ERROR = [0.002, 0.3]; // FLIP
const EV = 10; // steps of the slider to one stop
const EFFECTS = ["lights", "shadows", "ambient", "reflections", "transparency", "media"];

/** Two digits, but no powers of ten. */
const short = (value) => (value < 10 ? value.toPrecision(2) : String(Math.round(value)));
const densityOf = (place) => (place === 0 ? 0 : 100 ** (place / 50 - 1)); // 0, then 0.01 to 100, 1 in the middle
const onScale = ([low, high], share) => low * (high / low) ** share;
const shareOf = ([low, high], value) => Math.log(value / low) / Math.log(high / low);
const chosen = (name) => document.querySelector(`input[name=${name}]:checked`).value;
const choose = (name, value) => {
  for (const input of document.querySelectorAll(`input[name=${name}]`)) input.checked = input.value === value;
};

export class Settings {
  /**
   * `initial` are the words of the address. Calls `wish(what)` after a change that needs other pictures, `show()` after
   * one that does not, `resize()` after another resolution.
   */
  constructor({ initial, wish, show, resize }) {
    this.hooks = { wish, show, resize };
    this.touched = new Set(); // media that were changed: the others are as in the scene
    this.changed = false; // anything but bounds and layers, which a session begins with
    this.values = { budget: 150, error: 0.05 };
    this.ignored = {}; // words of the address
    this.restore(initial);
    this.listen();
    this.showAll();
  }

  listen() {
    const wish = (what, extra) => () => {
      extra?.();
      this.showAll();
      this.hooks.wish(what);
    };
    const look = (what) => wish(what, () => (this.changed = true));
    for (const input of document.querySelectorAll("input[name=mode]")) input.addEventListener("change", wish(input.value === "auto" ? "auto" : `${input.value} bound`));
    $("bound").addEventListener("input", () => {
      this.values[this.mode] = onScale(this.mode === "error" ? ERROR : BUDGET, $("bound").value / 100);
      this.showAll();
    });
    $("bound").addEventListener("change", () => this.hooks.wish("the bound"));
    $("layers").addEventListener("input", () => this.showAll());
    $("layers").addEventListener("change", () => this.hooks.wish("extra layers"));
    for (const [id, what] of [["density", "fog density"], ["asymmetry", "fog g"]]) {
      $(id).addEventListener("input", () => this.touched.add(id) && this.showAll());
      $(id).addEventListener("change", look(what));
    }
    $("play").addEventListener("change", look("the animation"));
    $("play").addEventListener("change", () => this.touched.add("play"), { capture: true });
    for (const input of document.querySelectorAll("input[name=exposure-mode]")) input.addEventListener("change", look("exposure"));
    $("exposure").addEventListener("input", () => {
      choose("exposure-mode", "manual");
      this.showAll();
      this.hooks.show(); // at once, from what is there
    });
    $("exposure").addEventListener("change", look("exposure"));
    $("tone").addEventListener("change", look("the tone curve"));
    for (const effect of EFFECTS) $(`effect-${effect}`).addEventListener("change", look(effect === "ambient" ? "ambient shading" : effect));
    for (const id of ["use-earlier", "use-layers", "use-fill"]) $(id).addEventListener("change", () => this.hooks.show());
    $("enhance").addEventListener("input", () => {
      this.showAll();
      this.hooks.show();
    });
    $("resolution").addEventListener("change", () => this.hooks.resize());
  }

  get mode() {
    return chosen("mode");
  }

  /** What POST /v1/sessions takes of it. */
  bounds() {
    return {
      budget_ms: this.mode === "budget" ? Math.round(this.values.budget) : null,
      max_error: this.mode === "error" ? Number(this.values.error.toPrecision(2)) : null,
      layers: Number($("layers").value),
    };
  }

  /** All of a SETTINGS message; null: as before. */
  message() {
    const value = (name, made) => (this.touched.has(name) ? made(Number($(name).value)) : null);
    return {
      ...this.bounds(),
      density: value("density", densityOf),
      asymmetry: value("asymmetry", (g) => g / 100),
      playing: this.touched.has("play") ? $("play").checked : null,
      exposure: this.ev ?? chosen("exposure-mode"),
      tone_map: $("tone").value,
      off: this.off,
    };
  }

  /** The exposure that was set by hand; null: none. */
  get ev() {
    return chosen("exposure-mode") === "manual" ? Number($("exposure").value) / EV : null;
  }

  /** Effects that are left out. */
  get off() {
    return EFFECTS.filter((effect) => !$(`effect-${effect}`).checked);
  }

  /** Which sources of samples the picture uses. */
  get sources() {
    return { earlier: $("use-earlier").checked, layers: $("use-layers").checked, fill: $("use-fill").checked, enhance: Number($("enhance").value) / 100 };
  }

  /** Another scene: what was wished for the media and the animation of the one before does not hold. */
  forgetScene() {
    this.touched.clear();
    $("play").checked = false;
    $("density").value = 50;
    $("asymmetry").value = 0;
    this.showAll();
  }

  /** What differs from the usual, as words for the address. */
  words() {
    const { budget_ms, max_error, layers } = this.bounds();
    const kind = chosen("exposure-mode");
    const ticked = (id) => ($(id).checked ? null : 0);
    return {
      budget_ms,
      max_error,
      layers: layers === 2 ? null : layers,
      ev: kind === "manual" ? this.ev : kind === "auto" ? "auto" : null,
      tone: $("tone").value === "none" ? null : $("tone").value,
      off: this.off.join(",") || null,
      fog: this.touched.has("density") ? $("density").value : null,
      g: this.touched.has("asymmetry") ? $("asymmetry").value : null,
      play: this.touched.has("play") && $("play").checked ? 1 : null,
      shape: Number($("enhance").value) || null,
      pixels: $("resolution").value === "medium" ? null : $("resolution").value,
      earlier: ticked("use-earlier"),
      extra: ticked("use-layers"),
      fill: ticked("use-fill"),
    };
  }

  /** The other way round. */
  restore(words) {
    const has = (name) => words[name] !== undefined && words[name] !== "";
    const number = (name, [low, high], put) => {
      const value = Number(words[name]);
      if (has(name) && value >= low && value <= high) put(value);
      else if (has(name)) this.ignore(name, words);
    };
    const word = (name, known, put) => {
      if (known.includes(words[name])) put(words[name]);
      else if (has(name)) this.ignore(name, words);
    };
    const options = (id) => [...$(id).options].map((option) => option.value);
    number("budget_ms", [1, 1e6], (ms) => (this.values.budget = ms) && choose("mode", "budget"));
    number("max_error", [1e-4, 1], (e) => (this.values.error = e) && choose("mode", "error"));
    number("layers", [0, 4], (n) => ($("layers").value = n));
    number("shape", [0, 100], (n) => ($("enhance").value = n));
    for (const [name, id, ends] of [["fog", "density", [0, 100]], ["g", "asymmetry", [-99, 99]]])
      number(name, ends, (n) => {
        $(id).value = n;
        this.touched.add(id);
      });
    if (words.play === "1") {
      $("play").checked = true;
      this.touched.add("play");
    }
    if (words.ev === "auto") choose("exposure-mode", "auto");
    else number("ev", [-16, 16], (ev) => {
      $("exposure").value = EV * ev;
      choose("exposure-mode", "manual");
    });
    word("tone", options("tone"), (tone) => ($("tone").value = tone));
    const off = (words.off ?? "").split(",").filter(Boolean);
    if (!off.every((effect) => EFFECTS.includes(effect))) this.ignore("off", words);
    else for (const effect of off) $(`effect-${effect}`).checked = false;
    word("pixels", options("resolution"), (pixels) => ($("resolution").value = pixels));
    for (const [name, id] of [["earlier", "use-earlier"], ["extra", "use-layers"], ["fill", "use-fill"]])
      word(name, ["0", "1"], (ticked) => ($(id).checked = ticked === "1"));
    this.changed = ["ev", "tone", "off", "fog", "g", "play"].some((name) => has(name) && !(name in this.ignored));
  }

  /** A word that means nothing here: the page begins as it would without. */
  ignore(name, words) {
    this.ignored[name] = words[name];
  }

  showAll() {
    const error = this.mode === "error";
    $("bound-row").hidden = this.mode === "auto";
    $("bound-name").textContent = error ? "largest error" : "budget";
    const value = this.values[error ? "error" : "budget"];
    $("bound").value = 100 * shareOf(error ? ERROR : BUDGET, value);
    $("bound-value").textContent = error ? value.toPrecision(2) : `${Math.round(value)} ms`;
    $("layers-value").textContent = $("layers").value;
    $("enhance-value").textContent = `${$("enhance").value} %`;
    $("density-value").textContent = `${short(densityOf(Number($("density").value)))} ×`;
    $("asymmetry-value").textContent = this.touched.has("asymmetry") ? (Number($("asymmetry").value) / 100).toFixed(2) : "own";
    if (this.ev !== null) this.showExposure(this.ev);
  }

  /** The exposure that the picture has. */
  showExposure(ev) {
    if (ev === null) return;
    if (this.ev === null) $("exposure").value = EV * ev;
    $("exposure-value").textContent = `${ev > 0 ? "+" : ev < 0 ? "−" : ""}${Math.abs(ev).toFixed(1)} EV`;
  }
}
