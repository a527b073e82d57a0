// The panel: how the server and the picture are, what runs and why, and what it costs.

const $ = (id) => document.getElementById(id);
const NAMES = { connecting: "connecting", live: "live", waiting: "reconnecting", failed: "stopped", closed: "closed" };
const KINDS = ["· moving", "· refined, nothing moves", "· refined, outlines smooth"];
const CHART_FRAMES = 148;
const CHART_MS = 50; // height of the chart
// Which passes an effect is made of.
const PASSES = {
  lights: ["direct_light", "light_reach"],
  shadows: ["shadow_map", "soft_shadow", "sky_shadow", "point_shadow", "pane_shadow", "occluders"],
  ambient: ["ambient_visibility"],
  reflections: ["reflections", "reflective_pixel", "reflection_reuse", "hit_shader", "ray_caster"],
  transparency: ["transparency"],
  media: ["scattering"],
};

const ms = (value) => (value == null ? "–" : `${value >= 100 ? Math.round(value) : value.toFixed(value >= 10 ? 0 : 1)} ms`);
const percent = (share) => (share == null ? "–" : `${(100 * share).toFixed(share < 0.1 ? 2 : 1)} %`);
const bytes = (count) => (count < 1e6 ? `${Math.round(count / 1000)} kB` : `${(count / 1e6).toFixed(1)} MB`);
const seconds = (milliseconds) => `${(milliseconds / 1000).toFixed(milliseconds < 9950 ? 1 : 0)} s`;

export class Panel {
  constructor() {
    this.frames = [];
    this.state = "connecting";
    this.detail = {};
    $("toggle").addEventListener("click", () => this.open($("panel").hidden));
    document.addEventListener("keydown", (event) => event.code === "Escape" && !$("panel").hidden && this.open(false));
  }

  open(open) {
    $("panel").hidden = !open;
    $("toggle").setAttribute("aria-expanded", String(open));
    $("brief").hidden = open;
    if (open) $("panel").scrollTop = 0;
    else if ($("panel").contains(document.activeElement)) $("toggle").focus();
  }

  showState(state, detail) {
    this.state = state;
    this.detail = detail;
    this.showNotice(null);
  }

  /** The state of the connection, or what is more worth saying. */
  showNotice(notice) {
    const waiting = this.state === "waiting" ? { text: "reconnecting", ms: 1000 * this.detail.seconds, before: " in " } : null;
    const { text, ms: passed, before = " · " } = notice ?? waiting ?? { text: NAMES[this.state] };
    $("status").dataset.state = notice ? notice.kind : this.state;
    $("status").title = this.detail?.reason ?? "";
    // Seconds tick: screen readers hear of what changes otherwise.
    if ($("status-text").textContent !== text) $("status-text").textContent = text;
    $("status-time").textContent = passed === undefined ? "" : before + seconds(passed);
  }

  /** A scene that moves can be played, one that does not cannot; fog can be changed where there is some. */
  showScene(scene) {
    $("play-row").hidden = Object.keys(scene.animations ?? {}).length === 0;
  }

  showPlan(header) {
    const plan = header.plan;
    if (!plan) return;
    const rows = plan.rows ?? [];
    $("plan-kind").textContent = KINDS[!header.still ? 0 : header.samples > 1 ? 2 : 1];
    $("plan-statement").textContent = [plan.statement, ...(plan.warnings ?? [])].filter(Boolean).join(" · ");
    $("plan").replaceChildren(...rows.map((row) => this.planRow(row)));
    $("plan").append(this.planRow({ pass: "together", runs: true, ...plan, reason: "", settings: "" }));
    const carried = rows.some((row) => row.pass === "carried_light" && row.runs); // light of earlier pictures
    for (const [effect, passes] of Object.entries(PASSES)) {
      const own = rows.filter((row) => passes.includes(row.pass));
      const run = own.filter((row) => row.runs);
      const cost = run.reduce((sum, row) => sum + (row.measured_ms ?? row.predicted_ms ?? 0), 0);
      const { checked } = $(`effect-${effect}`);
      const ran = checked ? ms(cost) : `for others ${ms(cost)}`; // such as the shading of what the surroundings light
      $(`cost-${effect}`).textContent = run.length ? ran : carried && checked ? "carried" : "nothing";
      $(`cost-${effect}`).title = own.map((row) => `${row.pass.replaceAll("_", " ")}: ${row.reason}`).join("\n");
    }
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
    this.showNotice(stats.notice);
    const age = stats.age_ms === null ? "picture current" : `picture ${seconds(stats.age_ms)} old`;
    if (!stats.shown) $("brief").textContent = fps ? `${fps} fps · no picture of this scene yet` : "";
    else $("brief").textContent = fps ? `${fps} fps · ${age} · ${percent(stats.holes)} filled · ${percent(stats.stretched)} stretched` : "";
    if ($("panel").hidden) return;
    $("s-frame").textContent = fps ? `${ms(stats.frame_ms)} · ${fps} fps` : "–";
    $("s-age").textContent = !stats.shown ? "–" : stats.age_ms === null ? "current" : seconds(stats.age_ms);
    $("s-warp").textContent = ms(stats.warp_ms);
    $("s-holes").textContent = percent(stats.holes);
    $("s-stretched").textContent = percent(stats.stretched);
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
