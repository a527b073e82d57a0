// The panel: what runs and why, figures, and what the user wishes for.

const $ = (id) => document.getElementById(id);
const BUDGET = [15, 2000]; // ms, ends of the logarithmic slider
const ERROR = [0.002, 0.3]; // FLIP
const NAMES = { connecting: "connecting", live: "live", waiting: "reconnecting", failed: "stopped", closed: "closed" };
const KINDS = ["· moving", "· refined, nothing moves", "· refined, outlines smooth"];
const CHART_FRAMES = 148;
const CHART_MS = 50; // height of the chart

const ms = (value) => (value == null ? "–" : `${value >= 100 ? Math.round(value) : value.toFixed(value >= 10 ? 0 : 1)} ms`);
const percent = (share) => (share == null ? "–" : `${(100 * share).toFixed(share < 0.1 ? 2 : 1)} %`);
const bytes = (count) => (count < 1e6 ? `${Math.round(count / 1000)} kB` : `${(count / 1e6).toFixed(1)} MB`);
const densityOf = (place) => (place === 0 ? 0 : 100 ** (place / 50 - 1)); // 0, then 0.01 to 100, 1 in the middle
const onScale = ([low, high], share) => low * (high / low) ** share;
const shareOf = ([low, high], value) => Math.log(value / low) / Math.log(high / low);

export class Panel {
  /** `wish(settings)` is called after the user changed a bound or the layers, `resize()` after a new resolution. */
  constructor({ wish, resize, show, initial }) {
    this.frames = [];
    this.values = { budget: initial.budget_ms ?? 150, error: initial.max_error ?? 0.05 };
    this.mode = initial.max_error ? "error" : initial.budget_ms ? "budget" : "auto";
    $("layers").value = initial.layers;
    for (const input of document.querySelectorAll("input[name=mode]")) {
      input.checked = input.value === this.mode;
      input.addEventListener("change", () => {
        this.mode = input.value;
        this.showBound();
        wish(this.settings());
      });
    }
    $("bound").addEventListener("input", () => {
      this.values[this.mode] = onScale(this.mode === "error" ? ERROR : BUDGET, $("bound").value / 100);
      this.showBound();
    });
    $("bound").addEventListener("change", () => wish(this.settings()));
    $("layers").addEventListener("input", () => this.showBound());
    $("layers").addEventListener("change", () => wish(this.settings()));
    for (const name of ["density", "asymmetry"]) {
      $(name).addEventListener("input", () => this.touched.add(name) && this.showMedia());
      $(name).addEventListener("change", () => wish(this.settings(), this.media()));
    }
    $("play").addEventListener("change", () => this.touched.add("play") && wish(this.settings(), this.media()));
    this.touched = new Set(); // sliders of media that were moved: the others leave the scene's own values
    this.showMedia();
    for (const name of ["use-earlier", "use-layers", "use-fill"]) $(name).addEventListener("change", show);
    $("enhance").addEventListener("input", () => {
      this.showBound();
      show();
    });
    $("resolution").addEventListener("change", resize);
    $("toggle").addEventListener("click", () => this.open($("panel").hidden));
    document.addEventListener("keydown", (event) => event.code === "Escape" && !$("panel").hidden && this.open(false));
    this.showBound();
  }

  open(open) {
    $("panel").hidden = !open;
    $("toggle").setAttribute("aria-expanded", String(open));
    $("brief").hidden = open;
    if (open) $("panel").scrollTop = 0;
  }

  settings() {
    return {
      budget_ms: this.mode === "budget" ? Math.round(this.values.budget) : null,
      max_error: this.mode === "error" ? Number(this.values.error.toPrecision(2)) : null,
      layers: Number($("layers").value),
    };
  }

  /** What media shall be like; null: as before. */
  media() {
    const value = (name, made) => (this.touched.has(name) ? made(Number($(name).value)) : null);
    const playing = this.touched.has("play") ? $("play").checked : null;
    return { density: value("density", densityOf), asymmetry: value("asymmetry", (g) => g / 100), playing };
  }

  /** A scene that moves can be played, one that does not cannot. */
  showScene(scene) {
    $("play-row").hidden = Object.keys(scene.animations ?? {}).length === 0;
  }

  showMedia() {
    $("density-value").textContent = `${densityOf(Number($("density").value)).toPrecision(2)} ×`;
    $("asymmetry-value").textContent = this.touched.has("asymmetry") ? (Number($("asymmetry").value) / 100).toFixed(2) : "own";
  }

  /** Which sources of samples the picture uses. */
  get sources() {
    return { earlier: $("use-earlier").checked, layers: $("use-layers").checked, fill: $("use-fill").checked, enhance: Number($("enhance").value) / 100 };
  }

  showBound() {
    const error = this.mode === "error";
    $("bound-row").hidden = this.mode === "auto";
    $("bound-name").textContent = error ? "largest error" : "budget";
    const value = this.values[error ? "error" : "budget"];
    $("bound").value = 100 * shareOf(error ? ERROR : BUDGET, value);
    $("bound-value").textContent = error ? value.toPrecision(2) : `${Math.round(value)} ms`;
    $("layers-value").textContent = $("layers").value;
    $("enhance-value").textContent = `${$("enhance").value} %`;
  }

  showState(state, detail) {
    const text = state === "waiting" ? `reconnecting in ${detail.seconds.toFixed(1)} s` : NAMES[state];
    $("status").dataset.state = state;
    $("status").title = detail?.reason ?? "";
    $("status").lastElementChild.textContent = text;
  }

  showPlan(header) {
    const plan = header.plan;
    if (!plan) return;
    $("plan-kind").textContent = KINDS[!header.still ? 0 : header.samples > 1 ? 2 : 1];
    $("plan-statement").textContent = plan.statement ?? "";
    $("plan").replaceChildren(...(plan.rows ?? []).map((row) => this.planRow(row)));
    $("plan").append(this.planRow({ pass: "together", runs: true, ...plan, reason: "", settings: "" }));
  }

  planRow(row) {
    const line = document.createElement("tr");
    line.className = row.runs ? "" : "off";
    const name = document.createElement("td");
    const why = document.createElement("small");
    const settings = typeof row.settings === "string" ? row.settings : Object.entries(row.settings ?? {}).map(([k, v]) => `${k} ${v}`).join(", ");
    why.textContent = [row.reason, settings].filter(Boolean).join(" · ");
    name.append(row.pass.replaceAll("_", " "), why);
    const cells = [row.predicted_ms, row.measured_ms].map((value) => {
      const cell = document.createElement("td");
      cell.textContent = row.runs ? ms(value) : "–";
      return cell;
    });
    line.append(name, ...cells);
    return line;
  }

  addFrame(milliseconds) {
    this.frames.push(milliseconds);
    if (this.frames.length > CHART_FRAMES) this.frames.shift();
  }

  showFigures(stats) {
    const fps = stats.frame_ms ? Math.round(1000 / stats.frame_ms) : null;
    $("brief").textContent = fps ? `${fps} fps · ${ms(stats.latency_ms)} · ${percent(stats.holes)} holes` : "";
    if ($("panel").hidden) return;
    $("s-frame").textContent = fps ? `${ms(stats.frame_ms)} · ${fps} fps` : "–";
    $("s-warp").textContent = ms(stats.warp_ms);
    $("s-holes").textContent = percent(stats.holes);
    $("s-drawn").textContent = `${stats.pictures} images`;
    $("s-latency").textContent = ms(stats.latency_ms);
    $("s-bandwidth").textContent = `${bytes(stats.bytes_per_second)}/s`;
    $("s-keyframe").textContent = stats.keyframe_bytes ? bytes(stats.keyframe_bytes) : "–";
    $("s-decode").textContent = ms(stats.decode_ms);
    this.drawChart();
  }

  drawChart() {
    const chart = $("chart");
    const draw = chart.getContext("2d");
    const { width, height } = chart;
    draw.clearRect(0, 0, width, height);
    draw.fillStyle = "rgb(255 255 255 / 12%)";
    draw.fillRect(0, height * (1 - 16.7 / CHART_MS), width, 1);
    draw.fillStyle = "#e8a355";
    this.frames.forEach((value, k) => {
      const tall = Math.max(1, Math.min(1, value / CHART_MS) * height);
      draw.fillRect(width - 2 * (this.frames.length - k), height - tall, 1.4, tall);
    });
  }
}
