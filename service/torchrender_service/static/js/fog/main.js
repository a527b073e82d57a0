// The page on which photos are marked: photo, marks, fog, files.

import { ServiceError } from "../stream.js";
import { inspect } from "./inspector.js";
import { Marks } from "./marks.js";
import { Painter } from "./painter.js";
import { Preview, converted, divide, sendPhoto } from "./preview.js";
import { EDGES, MAKERS, insertCorner, markOf, removeCorner, removeMark, shapesOf } from "./shapes.js";
import { Sliders } from "./sliders.js";
import { View } from "./view.js";

const SENT_AS_THEY_ARE = ["image/jpeg", "image/png"];
const $ = (id) => document.getElementById(id);

let key = sessionStorage.getItem("torchrender.key");
let photo = null; // { id, width, height, name, url }
let selected = null;
let facts = null;
let shown = null; // address of the preview

function say(text, kind = "note") {
  $("message").hidden = !text;
  $("message").textContent = text ?? "";
  $("message").dataset.kind = kind;
}

const marks = new Marks(() => refresh());
const sliders = new Sliders(() => preview.ask());
const view = new View(
  { stage: $("stage"), paper: $("paper"), ink: $("ink"), loupe: $("loupe") },
  {
    grab: () => marks.remember(),
    move: (places) => {
      for (const [path, place] of places) marks.set(path, typeof place === "number" ? tenth(place) : place.map(tenth));
      refresh();
    },
    drop: () => refresh(),
    insert: (path, k, place) => {
      insertCorner(marks, path, k, place);
      select([...path, k + 1]);
    },
    select: (path) => select(path),
    stroke: (points, width) => painter.add(points, width),
  },
);
const tenth = (v) => Math.round(10 * v) / 10;

const painter = new Painter($("parts"), {
  brush: (brush) => {
    view.brush = brush;
    redraw();
  },
  divide: (body) => label(body),
});

const preview = new Preview(
  () => (photo && !marks.missing() ? { photo_id: photo.id, marks: marks.file(photo.width, photo.height), ...sliders.values } : null),
  {
    picture: (url) => showPicture(url),
    facts: (found) => {
      facts = found;
      showFacts();
      redraw();
    },
    said: (warnings) => say(warnings.join(" · ")),
    busy: (busy) => ($("status").dataset.state = busy ? "connecting" : "live"),
    failed: (error) => failed(error, () => preview.ask()),
  },
);

/** Say what went wrong; ask for the key, or send the photo again, where that helps. */
async function failed(error, again) {
  if (error instanceof ServiceError && error.status === 401) {
    await askKey();
    return again();
  }
  if (error instanceof ServiceError && error.status === 404 && photo) {
    await sendPhoto(photo.blob, key);
    return again();
  }
  facts = preview.known = null;
  showFacts();
  redraw();
  say(error.name === "TimeoutError" ? "The service takes too long." : error.message, "error");
}

function askKey() {
  return new Promise((done) => {
    $("key-dialog").addEventListener("close", () => {
      key = preview.key = $("key").value;
      sessionStorage.setItem("torchrender.key", key);
      done();
    }, { once: true });
    $("key-dialog").showModal();
  });
}

// ------------------------------------------------------------------------------------ marks

function select(path) {
  selected = path;
  redraw();
  inspect($("fields"), marks, selected, (make) => marks.change(make));
  $("remove").disabled = !path;
  const outline = path && marks.at(path.slice(0, -1));
  $("remove-corner").disabled = !path || !(typeof path.at(-1) === "number" && Array.isArray(outline) && Array.isArray(outline[0]) && outline.length > 3) && path.length !== 3;
}

/** Everything after marks have changed. */
function refresh() {
  if (selected && marks.at(selected) === undefined) selected = null;
  for (const button of document.querySelectorAll("#kind button")) button.setAttribute("aria-pressed", String((button.value === "indoors") === marks.indoors));
  sliders.setIndoors(marks.indoors);
  if (marks.indoors && view.brush) paint(false);
  $("undo").disabled = !marks.past.length;
  $("redo").disabled = !marks.future.length;
  if (!view.drag) select(selected);
  else redraw();
  say(photo ? marks.missing() : "Open a photo, or drop one here.");
  preview.ask();
}

function redraw() {
  if (!photo) return;
  const fitted = facts?.corners_px && marks.indoors ? box(facts) : [];
  view.draw({ shapes: shapesOf(marks, photo.width), selected, fitted, strokes: view.brush ? painter.drawn : [] });
}

/** Edges of the room that the service found, in pixels of the photo. */
function box({ corners_px: corners, size }) {
  const [x, y] = [photo.width / size[0], photo.height / size[1]];
  const at = (name) => corners[name] && [corners[name][0] * x, corners[name][1] * y];
  return EDGES.map((pair) => pair.map(at)).filter(([a, b]) => a && b);
}

function showFacts() {
  const meters = (values) => values.map((v) => v.toFixed(1)).join(" × ");
  const strong = (values) => Math.max(...values).toPrecision(2);
  const rows = [];
  if (facts?.room_size_m) {
    const stretch = photo.width / facts.size[0];
    rows.push(["room", `${meters(facts.room_size_m)} m`], ["corners off by", `${(facts.corner_error_px * stretch).toFixed(1)} px`]);
    rows.push(["focal length", `${Math.round(facts.focal_px * stretch)} px`]);
    for (const [name, strength] of Object.entries(facts.lights)) rows.push([name.replace(/\[(\d+)\]/, (_, k) => ` ${Number(k) + 1}`), strong(strength)]);
    rows.push(["from everywhere", strong(facts.ambient)]);
    if (facts.sun_irradiance) rows.push(["sun", strong(facts.sun_irradiance)], ["lit floor overlaps", `${Math.round(100 * facts.sun_iou)} %`]);
  } else if (facts?.depth_m) {
    rows.push(["depth", `${facts.depth_m[0]} – ${Math.round(facts.depth_m[1])} m`], ["sky", strong(facts.sky_radiance)]);
    rows.push(["sun", strong(facts.sun_irradiance)], ["sun's height", `${Math.round(facts.sun_elevation_deg)}°`]);
  }
  $("found").replaceChildren(...rows.map(([name, value]) => {
    const row = document.createElement("div");
    row.append(Object.assign(document.createElement("dt"), { textContent: name }), Object.assign(document.createElement("dd"), { textContent: value }));
    return row;
  }));
}

async function label(body) {
  $("status").dataset.state = "connecting";
  const asked = (label.last = {});
  try {
    const { region } = await divide(photo.id, body, key);
    if (asked !== label.last) return;
    marks.change((table) => (table.region = region));
  } catch (error) {
    failed(error, () => label(body));
  }
}

function paint(on) {
  view.brush = on ? painter.brush : null;
  $("paint").setAttribute("aria-pressed", String(on));
  $("parts").hidden = !on;
  if (on) {
    selected = null;
    say("A stroke on each part; + thing for what stands at another distance. Two fingers or the wheel zoom.");
  }
  redraw();
}

function remove(whole) {
  if (!selected) return;
  marks.change(() => {
    if (whole || !removeCorner(marks, selected)) removeMark(marks, selected);
    selected = null;
  });
}

function nudge(event) {
  const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
  const place = selected && marks.at(selected);
  if (!by || place === undefined || !(typeof place === "number" || typeof place[0] === "number")) return false;
  const step = event.shiftKey ? 10 : 1;
  marks.change(() => marks.set(selected, typeof place === "number" ? place + by[1] * step : place.map((v, k) => v + by[k] * step)));
  return true;
}

// ------------------------------------------------------------------------------------ files

async function openPhoto(file) {
  say("Sending the photo …");
  let opened;
  try {
    const blob = SENT_AS_THEY_ARE.includes(file.type) ? file : await asPng(file);
    const kept = await sendPhoto(blob, key);
    opened = { ...kept, name: file.name?.replace(/\.[^.]*$/, "") || "photo", url: URL.createObjectURL(blob), blob };
  } catch (error) {
    return failed(error, () => openPhoto(file));
  }
  $("photo").src = opened.url;
  await $("photo").decode().catch(() => {});
  // From here to the end without a pause: what is marked meanwhile belongs to the photo before.
  if (photo) URL.revokeObjectURL(photo.url);
  photo = opened;
  facts = preview.known = null;
  showPicture(null);
  painter.clear();
  Object.assign(marks, { table: {}, past: [], future: [] });
  selected = null;
  document.body.classList.add("open");
  view.show(photo.width, photo.height, photo.url);
  for (const element of document.querySelectorAll("[data-needs-photo]")) element.disabled = false;
  refresh();
}

/** Pictures of other kinds that the browser can show. */
async function asPng(file) {
  const bitmap = await createImageBitmap(file).catch(() => {
    throw new Error("This file is no picture that the browser can read.");
  });
  const canvas = Object.assign(document.createElement("canvas"), { width: bitmap.width, height: bitmap.height });
  canvas.getContext("2d").drawImage(bitmap, 0, 0);
  return new Promise((done) => canvas.toBlob(done, "image/png"));
}

async function openMarks(file) {
  if (!photo) return say("Open the photo first that these marks belong to.", "error");
  const kind = file.name.toLowerCase().endsWith(".json") ? "json" : "toml";
  try {
    const table = JSON.parse(await converted(await file.text(), kind, "json", key));
    marks.load(table, photo.width, photo.height);
    if (table.labels) say("The picture of labels that these marks name cannot be read here: paint the parts.", "error");
  } catch (error) {
    failed(error, () => openMarks(file));
  }
}

async function saveMarks() {
  const kind = $("marks-kind").value;
  try {
    const text = await converted(JSON.stringify(marks.file(photo.width, photo.height)), "json", kind, key);
    download(new Blob([text], { type: `application/${kind}` }), `${photo.name}.${kind}`);
  } catch (error) {
    failed(error, saveMarks);
  }
}

async function savePicture() {
  $("status").dataset.state = "connecting";
  try {
    const blob = await preview.full();
    if (blob) download(blob, `${photo.name}-fog.png`);
    else say(marks.missing(), "error");
  } catch (error) {
    failed(error, savePicture);
  }
  $("status").dataset.state = "live";
}

function download(blob, name) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

async function showPicture(url) {
  const before = shown;
  shown = url;
  if (url) {
    $("picture").src = url;
    await $("picture").decode().catch(() => {});
  }
  $("picture").hidden = !url;
  if (before) URL.revokeObjectURL(before);
}

function take(file) {
  if (!file) return;
  if (/\.(toml|json)$/i.test(file.name)) openMarks(file);
  else openPhoto(file);
}

// ------------------------------------------------------------------------------------- page

function listen() {
  const press = (id, then) => $(id).addEventListener("click", then);
  for (const id of ["photo-file", "marks-file"])
    $(id).addEventListener("change", () => {
      take($(id).files[0]);
      $(id).value = "";
    });
  press("open-photo", () => $("photo-file").click());
  press("open-marks", () => $("marks-file").click());
  press("save-marks", saveMarks);
  press("save-picture", savePicture);
  press("undo", () => marks.undo());
  press("redo", () => marks.redo());
  press("fit", () => view.fit());
  press("remove", () => remove(true));
  press("remove-corner", () => remove(false));
  press("paint", () => paint(!view.brush));
  for (const button of document.querySelectorAll("#kind button"))
    button.addEventListener("click", () => {
      selected = null;
      marks.change(() => (marks.indoors = button.value === "indoors"));
    });
  for (const button of document.querySelectorAll("button[data-make]"))
    button.addEventListener("click", () => {
      paint(false);
      selected = marks.change(() => MAKERS[button.dataset.make](marks, view.middle, [photo.width, photo.height]));
      select(selected);
    });
  const compare = (on) => $("picture").classList.toggle("away", on);
  $("compare").addEventListener("pointerdown", () => compare(true));
  for (const name of ["pointerup", "pointercancel", "pointerleave", "blur"]) $("compare").addEventListener(name, () => compare(false));
  $("hide-marks").addEventListener("change", () => ($("ink").style.visibility = $("hide-marks").checked ? "hidden" : ""));
  document.addEventListener("dragover", (event) => event.preventDefault());
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    take(event.dataTransfer.files[0]);
  });
  window.addEventListener("resize", () => photo && view.fit());
  document.addEventListener("keydown", onKey);
}

function onKey(event) {
  if (/^(INPUT|SELECT|TEXTAREA)$/.test(document.activeElement?.tagName) || $("key-dialog").open) return;
  const command = event.ctrlKey || event.metaKey;
  if (command && event.key.toLowerCase() === "z") event.shiftKey ? marks.redo() : marks.undo();
  else if (command && event.key.toLowerCase() === "y") marks.redo();
  else if (event.key === "Delete" || event.key === "Backspace") remove(event.shiftKey);
  else if (event.key === "Escape") view.brush ? paint(false) : select(null);
  else if (!nudge(event)) return;
  event.preventDefault();
}

/** Read-only view of the page for tests and curious users; static/README.md describes it. */
window.torchrenderFog = Object.freeze({
  get marks() {
    return photo ? structuredClone(marks.file(photo.width, photo.height)) : null;
  },
  get photo() {
    return photo && { id: photo.id, width: photo.width, height: photo.height };
  },
  get stats() {
    return { ...preview.stats };
  },
  get idle() {
    return preview.idle;
  },
  get facts() {
    return structuredClone(facts);
  },
  get selected() {
    return structuredClone(selected);
  },
  toClient: (place) => view.toClient(place),
});

preview.key = key;
listen();
inspect($("fields"), marks, null, (make) => marks.change(make));
refresh();
