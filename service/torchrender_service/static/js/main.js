// The page: scenes, wishes, messages; the client does the rest.
//
// Query parameters: scene, width, height (pixels of the stream), layers, overscan, budget_ms, max_error.

import { Client } from "./client.js";
import { Walker } from "./controls.js";
import { received } from "./keyframes.js";
import { Panel } from "./panel.js";
import { ServiceError, request } from "./stream.js";

const FIRST_SCENE = "living_room";
const RESOLUTIONS = [
  ["low", 320 * 180],
  ["medium", 640 * 360],
  ["high", 960 * 540],
  ["full", 1280 * 720],
];
const OVERSCAN = 1.2;
const RETRY = 1500; // ms between attempts to get the list of scenes
const RESIZE_WAIT = 400; // ms without a change of the window before the stream gets its new size

const $ = (id) => document.getElementById(id);
const query = new URLSearchParams(location.search);
const number = (name, fallback) => (query.has(name) && Number.isFinite(Number(query.get(name))) ? Number(query.get(name)) : fallback);

const fixed = query.has("width") && query.has("height");
let client = null;
let key = sessionStorage.getItem("torchrender.key");
let size = null;

function say(text) {
  $("message").hidden = !text;
  $("message").textContent = text ?? "";
}

const panel = new Panel({
  initial: { layers: number("layers", 2), budget_ms: number("budget_ms", null), max_error: number("max_error", null) },
  wish: (settings, media) => client?.wish(settings, media),
  resize: () => restart(),
  show: () => client && (client.dirty = true),
});

/** Pixels of the stream: as the address says, or the window's shape with the chosen number of pixels. */
function streamSize() {
  if (fixed) return [number("width", 640), number("height", 360)];
  const pixels = Number($("resolution").value);
  const { innerWidth: w, innerHeight: h } = window;
  const height = Math.sqrt((pixels * h) / w);
  return [(height * w) / h, height].map((side) => Math.max(64, 2 * Math.round(side / 2)));
}

/** Scale the canvas into the window, whole and in its own shape. */
function layOut() {
  const [width, height] = size ?? streamSize();
  const scale = Math.min(window.innerWidth / width, window.innerHeight / height);
  // The window's own shape differs from the stream's by rounding only.
  const fill = !fixed && Math.abs((width / height) * (window.innerHeight / window.innerWidth) - 1) < 0.02;
  $("stage").style.width = fill ? "100vw" : `${scale * width}px`;
  $("stage").style.height = fill ? "100dvh" : `${scale * height}px`;
}

function restart() {
  if (!client || !$("scene").value) return;
  size = streamSize();
  layOut();
  say("");
  const settings = Object.fromEntries(Object.entries(panel.settings()).filter(([, value]) => value !== null));
  const overscan = number("overscan", OVERSCAN);
  client.start({ scene: $("scene").value, width: size[0], height: size[1], overscan, ...settings }, key ?? undefined);
}

function onState(state, detail) {
  panel.showState(state, detail);
  if (state === "failed" && detail.status === 401) askKey(restart);
  else if (state === "failed") say(detail.message);
  else if (state === "live") say("");
}

function askKey(then) {
  const dialog = $("key-dialog");
  if (dialog.open) return;
  dialog.addEventListener("close", () => {
    key = $("key").value;
    sessionStorage.setItem("torchrender.key", key);
    then();
  }, { once: true });
  dialog.showModal();
}

async function loadScenes() {
  for (;;) {
    try {
      const found = [];
      for (let next = "v1/scenes"; next; ) {
        const page = await request(next, { key, patience: 10_000 });
        found.push(...page.scenes);
        next = page.next;
      }
      return found;
    } catch (error) {
      if (error instanceof ServiceError && error.status === 401) await new Promise(askKey);
      else {
        panel.showState("waiting", { seconds: RETRY / 1000, reason: error.message });
        await new Promise((wake) => setTimeout(wake, RETRY));
      }
    }
  }
}

function showScenes(scenes) {
  const name = (scene) => (scene.name || scene.id).replaceAll("_", " ");
  $("scene").replaceChildren(...scenes.map((scene) => new Option(name(scene), scene.id)));
  const wanted = query.get("scene") ?? FIRST_SCENE;
  const first = scenes.find((scene) => scene.id === wanted || scene.name === wanted) ?? scenes[0];
  if (!first) return say("The server has no scenes.");
  $("scene").value = first.id;
  $("scene").disabled = false;
  $("scene").addEventListener("change", () => {
    restart();
    $("scene").blur(); // so that the next key walks
  });
  restart();
}

function showContext(lost) {
  say(lost ? "The graphics card dropped the picture. It comes back by itself in a moment." : "");
}

/** Read-only view of the client for tests and curious users; service/static/README.md describes it. */
function expose() {
  window.torchrender = Object.freeze({
    get state() {
      return client.state;
    },
    get stats() {
      return client.stats;
    },
    get camera() {
      return structuredClone(client.walker.camera);
    },
    get moving() {
      return client.moving;
    },
    get keyframes() {
      return client.keyframes.groups.map((group) => structuredClone({ ...group.header, received: received(group) }));
    },
    get scene() {
      return client.wishes?.scene ?? null;
    },
    capture: (options) => client.capture(options),
    measure: (count, sources) => client.measure(count, sources),
  });
}

function begin() {
  $("resolution").replaceChildren(...RESOLUTIONS.map(([name, pixels]) => new Option(name, pixels)));
  $("resolution").value = RESOLUTIONS[1][1];
  $("resolution").disabled = fixed;
  const walker = new Walker($("stage"), $("stick"));
  try {
    client = new Client($("stage"), walker, {
      state: onState,
      keyframe: (header) => panel.showPlan(header),
      frame: (ms) => panel.addFrame(ms),
      figures: (stats) => panel.showFigures(stats),
      sources: () => panel.sources,
      context: showContext,
      scene: (scene) => panel.showScene(scene),
    });
  } catch (error) {
    panel.showState("failed", { reason: error.message });
    say("This page needs WebGL2, which this browser does not offer. Try a current browser, or switch on hardware acceleration.");
    return;
  }
  expose();
  layOut();
  const understood = () => $("help").classList.add("done");
  for (const element of [$("stage"), $("stick")]) element.addEventListener("pointerup", understood);
  window.addEventListener("keyup", (event) => event.code !== "Tab" && understood());
  let timer = 0;
  window.addEventListener("resize", () => {
    layOut();
    clearTimeout(timer);
    timer = setTimeout(() => !fixed && String(streamSize()) !== String(size) && restart(), RESIZE_WAIT);
  });
  loadScenes().then(showScenes);
}

begin();
