// The page: scenes, wishes, messages; the client does the rest. What the address may say is in ../README.md.

import { cameraOf, readWords, viewText, writeWords } from "./address.js";
import { Client } from "./client.js";
import { Walker } from "./controls.js";
import { received } from "./keyframes.js";
import { Obstacles } from "./obstacles.js";
import { Panel } from "./panel.js";
import { Settings } from "./settings.js";
import { ServiceError, askSession, request } from "./stream.js";
import { Upload } from "./upload.js";
import { Views } from "./views.js";

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
const WALLS_WAIT = 500; // ms without a change of the scene before its walls are asked for again
const NOTICE = 12_000; // ms for which something is said in passing
const ADDRESS_WAIT = 400; // ms without movement before the view stands in the address

const $ = (id) => document.getElementById(id);
const words = readWords();
const within = (name, low, high) => Number(words[name]) >= low && Number(words[name]) <= high;
const number = (name, [low, high], fallback) => (within(name, low, high) ? Number(words[name]) : fallback);

const SIDES = [1, 8192]; // pixels of a stream's picture
const fixed = within("width", ...SIDES) && within("height", ...SIDES);
let client = null;
let views = null;
let upload = null;
let key = sessionStorage.getItem("torchrender.key");
let size = null;
let scene = words.scene ?? FIRST_SCENE; // id of what is shown
let scenes = null; // of the server; null: not known yet
let addressTimer = 0;
let wallsTimer = 0;
let tellTimer = 0;
let revision = 0; // of the scene
let told = new Set(); // doubts about the scene that were said

function say(text) {
  $("message").hidden = !text;
  $("message").textContent = text ?? "";
}

/** Say something in passing. */
function tell(text) {
  clearTimeout(tellTimer);
  $("notice").hidden = !text;
  $("notice").textContent = text;
  tellTimer = setTimeout(() => ($("notice").hidden = true), NOTICE);
}

$("resolution").replaceChildren(...RESOLUTIONS.map(([name]) => new Option(name, name)));
$("resolution").value = "medium";
$("resolution").disabled = fixed;
const panel = new Panel();
const settings = new Settings({
  initial: words,
  wish: (what) => {
    client?.wish(settings.message(), what);
    noteSoon();
  },
  show: () => {
    if (client) client.dirty = true;
    noteSoon();
  },
  resize: () => {
    restart();
    noteSoon();
  },
});

/** Pixels of the stream: as the address says, or the window's shape with the chosen number of pixels. */
function streamSize() {
  if (fixed) return [Number(words.width), Number(words.height)];
  const pixels = RESOLUTIONS.find(([name]) => name === $("resolution").value)[1];
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

/** The body of POST /v1/sessions. */
function sessionWishes() {
  size = streamSize();
  const bounds = Object.fromEntries(Object.entries(settings.bounds()).filter(([, value]) => value !== null));
  const overscan = number("overscan", [1, 2], OVERSCAN);
  return { scene, width: size[0], height: size[1], overscan, ...bounds };
}

function restart() {
  if (client && scene) stream(sessionWishes());
}

/** `asked`: the answer to these wishes, where they were sent already. */
function stream(wishes, asked) {
  layOut();
  say("");
  client.settings = settings.changed ? settings.message() : null;
  client.start(wishes, key ?? undefined, asked);
}

function onState(state, detail) {
  if (state === "failed" && detail.status === 404 && !scenes) return; // the list of scenes will tell another one
  panel.showState(state, detail);
  if (state === "failed" && detail.status === 401) askKey(restart);
  else if (state === "failed") say(detail.status === 404 ? goneText() : detail.message);
  else if (state === "live") say("");
}

/** The scene that is shown is no longer there: an id of 64 digits would tell nobody which. */
function goneText() {
  const { name } = scenes.find((one) => one.id === scene) ?? {};
  return name ? `The scene ${name.replaceAll("_", " ")} was deleted.` : "There is no such scene.";
}

function askKey(then) {
  const dialog = $("key-dialog");
  dialog.addEventListener("close", () => {
    key = $("key").value;
    sessionStorage.setItem("torchrender.key", key);
    then();
  }, { once: true });
  if (!dialog.open) dialog.showModal();
}

// ------------------------------------------------------------------ the address

/** Scene, view and settings, once nothing moves any more. */
function noteSoon() {
  clearTimeout(addressTimer);
  addressTimer = setTimeout(note, ADDRESS_WAIT);
}

function note() {
  if (!client?.walker.camera || !scene) return;
  const { walker } = client;
  const atHome = walker.camera.world_from_camera.every((v, k) => v === walker.home.world_from_camera[k]);
  writeWords({
    scene: scene === FIRST_SCENE && words.scene === undefined ? null : scene,
    view: atHome ? null : viewText(walker),
    controls: walker.mode === client.scene?.controls ? null : walker.mode,
    ...settings.words(),
  });
}

/** The first welcome to a scene, or another one to the same. */
function onScene(facts, first) {
  client.scene = facts;
  panel.showScene(facts);
  upload.showScene(facts.id);
  if (!first) return;
  told = new Set();
  if (["walk", "orbit"].includes(words.controls)) client.walker.setMode(words.controls);
  else if (words.controls) settings.ignore("controls", words);
  delete words.controls;
  const start = cameraOf(words.view, client.walker.camera, client.walker.up);
  if (start) client.walker.jumpTo(start);
  else if (words.view) settings.ignore("view", words);
  delete words.view; // of the scene that the page began with
  tellIgnored();
  noteSoon(); // a scene that took long to come is not in the address yet
  views.showMode();
  views.showCameras({});
  survey(facts.id);
}

/** Words of a link that mean nothing here, once. */
function tellIgnored() {
  for (const name of ["width", "height"]) if (words[name] !== undefined && !fixed) settings.ignore(name, words);
  const names = Object.entries(settings.ignored).map(([name, value]) => `${name}=${value.slice(0, 40)}`);
  if (names.length) {
    tell(`The link says what is not known here, and was left out: ${names.join(", ")}`);
    noteSoon(); // the address says what is shown
  }
  settings.ignored = {};
}

/** The server does not do what was asked; where that was the view of a link, the scene's own takes its place. */
function onRefused({ status, title, detail }) {
  if (status === 404) return; // the scene is gone: the end of the stream says so
  const lost = !client.keyframes.newest && client.walker.camera && client.walker.camera !== client.walker.home;
  if (lost) client.walker.reset();
  tell(`The server refuses: ${detail || title}${lost ? "; the view is the scene's own" : ""}`);
  if (lost) noteSoon();
}

/** What the renderer doubts about a scene, once each, where nothing else is being said; the panel has it all the time. */
function tellDoubts(doubts) {
  const fresh = doubts.filter((doubt) => !told.has(doubt));
  if (!fresh.length || !$("notice").hidden) return;
  for (const doubt of fresh) told.add(doubt);
  tell(fresh.join(" · "));
}

/** A scene that its program changes has other walls, once it rests. */
function onPicture(header) {
  panel.showPlan(header);
  tellDoubts(header.plan?.warnings ?? []);
  const now = header.revision ?? 0;
  if (now === revision) return;
  revision = now;
  clearTimeout(wallsTimer);
  wallsTimer = setTimeout(() => {
    if (!client.scene) return;
    survey(client.scene.id);
    nameAgain(client.scene.id);
  }, WALLS_WAIT);
}

/** What a program shows may have become another scene. */
async function nameAgain(id) {
  try {
    const facts = await request(`v1/scenes/${id}`, { key });
    scenes = scenes?.map((one) => (one.id === id ? facts : one)) ?? null;
    if (scenes) fillScenes();
    if (client.scene.id === id) panel.showScene(facts);
  } catch (error) {
    console.info(`the scene keeps its name: ${error.message}`);
  }
}

/** Cameras and obstacles of a scene: what is asked for after its first picture is under way. */
async function survey(id) {
  try {
    const found = await request(`v1/scenes/${id}/survey`, { key });
    if (client.scene.id !== id) return;
    views.showCameras(found.cameras);
    client.walker.obstacles = new Obstacles(found.obstacles);
  } catch (error) {
    console.info(`walls are not known: ${error.message}`); // walking works without
  }
}

// ------------------------------------------------------------------ scenes

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
      else await new Promise((wake) => setTimeout(wake, RETRY));
    }
  }
}

function fillScenes() {
  const name = (one) => (one.name || one.id).replaceAll("_", " ");
  $("scene").replaceChildren(...scenes.map((one) => new Option(name(one), one.id)));
  $("scene").value = scene;
}

function showScenes(found) {
  scenes = found;
  const wanted = scene;
  const first = scenes.find(({ id, name }) => id === wanted || name === wanted) ?? scenes[0];
  if (!first) return say("The server has no scenes.");
  if (words.scene && first.id !== wanted && first.name !== wanted) {
    settings.ignore("scene", words);
    if (words.view) settings.ignore("view", words);
    delete words.view;
    delete words.scene;
  }
  scene = first.id;
  fillScenes();
  $("scene").disabled = false;
  $("scene").addEventListener("change", () => {
    changeScene($("scene").value);
    $("scene").blur(); // so that the next key walks
  });
  if (scene !== wanted || client.state === "failed") restart();
}

function changeScene(id) {
  $("scene").value = id;
  delete words.view;
  scene = words.scene = id;
  settings.forgetScene();
  restart();
}

function onUploaded(facts) {
  scenes ??= [];
  if (!scenes.some(({ id }) => id === facts.id)) scenes.push(facts);
  fillScenes();
  changeScene(facts.id);
}

function onDeleted(id) {
  scenes = scenes.filter((one) => one.id !== id);
  fillScenes();
  if (scenes.length) changeScene(scenes[0].id);
  else scene = null;
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
    get controls() {
      return client.walker.mode;
    },
    get walls() {
      return client.walker.obstacles !== null;
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
    get picked() {
      return structuredClone(client.picked);
    },
    capture: (options) => client.capture(options),
    measure: (count, sources) => client.measure(count, sources),
  });
}

function listen() {
  const understood = () => $("help").classList.add("done");
  for (const element of [$("stage"), $("stick")]) element.addEventListener("pointerup", understood);
  window.addEventListener("keyup", (event) => event.code !== "Tab" && understood());
  let timer = 0;
  window.addEventListener("resize", () => {
    layOut();
    clearTimeout(timer);
    timer = setTimeout(() => !fixed && String(streamSize()) !== String(size) && restart(), RESIZE_WAIT);
  });
}

function begin() {
  const wishes = sessionWishes();
  const asked = askSession(wishes, key ?? undefined); // first of all: it is answered while the rest begins
  client = new Client($("stage"), new Walker($("stage"), $("stick")), {
    state: onState,
    keyframe: onPicture,
    frame: (ms) => panel.addFrame(ms),
    figures: (stats) => {
      panel.showFigures(stats);
      settings.showExposure(stats.exposure);
    },
    sources: () => settings.sources,
    exposure: () => settings.ev,
    context: showContext,
    scene: onScene,
    moved: noteSoon,
    refused: onRefused,
    picked: (found) => {
      client.picked = found;
      views.showPicked(found);
    },
    unable: (error) => {
      panel.showState("failed", { reason: error.message });
      say("This page needs WebGL2, which this browser does not offer. Try a current browser, or switch on hardware acceleration.");
    },
  });
  const known = () => {
    const facts = scenes?.find((one) => one.id === scene);
    return facts && !facts.built_in ? `${facts.name}.${facts.kind === "zip" ? "gltf" : facts.kind}` : scene;
  };
  const link = () => {
    note();
    return location.href;
  };
  views = new Views({ client, name: known, settings, changed: noteSoon, link });
  upload = new Upload({ key: () => key, ready: onUploaded, gone: onDeleted, tell });
  expose();
  listen();
  stream(wishes, asked);
  loadScenes().then(showScenes);
}

begin();
