// The state of the page in its address, and views as text to take elsewhere.

import { axesTowards } from "./controls.js";
import { add, axesOf, eyeOf, length, normalize, placed, scale, subtract } from "./camera.js";

const DIGITS = 8;
const FARTHEST = 1e12; // coordinate that a view may have
const AHEAD = 0.2; // of the diagonal: how far before a walker the point lies that the text names
const LEAST_AHEAD = 1e-8; // of the eye's coordinates: nearer points are hardly told from the eye itself

/** Words of the address by name. */
export const readWords = () => Object.fromEntries(new URLSearchParams(location.search));

/** Put words into the address without a new entry in the history; null takes one away. */
export function writeWords(words) {
  const query = new URLSearchParams(location.search);
  for (const [name, value] of Object.entries(words)) {
    if (value === null || value === undefined) query.delete(name);
    else query.set(name, value);
  }
  const text = query.toString().replaceAll("%2C", ",");
  history.replaceState(null, "", text ? `?${text}` : location.pathname);
}

const short = (v, digits = DIGITS) => Number(v.toPrecision(digits));
const size = (v) => Math.max(...v.map(Math.abs));

/** Where a walker stands and what it looks at. */
export function placeOf(walker) {
  const eye = eyeOf(walker.camera);
  const far = Math.max(AHEAD * walker.diagonal, LEAST_AHEAD * size(eye));
  const target = walker.orbiting ? walker.pivot : add(eye, scale(normalize(axesOf(walker.camera)[2]), far));
  // Far from the origin the direction is in the last digits.
  const apart = length(subtract(target, eye)) || 1;
  const more = Math.ceil(Math.max(0, Math.log10(size(eye) / apart)));
  const digits = Math.min(17, DIGITS + more);
  return { eye: eye.map((v) => short(v, digits)), target: target.map((v) => short(v, digits)) };
}

/** A view as six numbers: eye and target. */
export function viewText(walker) {
  const { eye, target } = placeOf(walker);
  return [...eye, ...target].join(",");
}

/** The camera of such a text, with the size and opening angle of `camera`; null: it is none, or out of
 * any reach. */
export function cameraOf(text, camera, up) {
  const numbers = (text ?? "").split(",").map(Number);
  if (numbers.length !== 6 || !numbers.every((v) => Math.abs(v) <= FARTHEST)) return null;
  const [eye, target] = [numbers.slice(0, 3), numbers.slice(3)];
  const way = target.map((v, k) => v - eye[k]);
  if (Math.hypot(...way) === 0) return null;
  return { ...placed(camera, eye, axesTowards(way, up)), target };
}

const degrees = (camera) => short((360 / Math.PI) * Math.atan((0.5 * camera.height) / camera.fy));

/** Lines of Python that render the view; `name` of the scene, or of its file. */
export function pythonText(walker, name, { ev, tone }) {
  const { eye, target } = placeOf(walker);
  const { width, height } = walker.camera;
  const tuple = (v) => `(${v.join(", ")})`;
  const look = [ev === null ? null : `exposure=${ev}`, tone === "none" ? null : `tone_map="${tone}"`].filter(Boolean);
  const options = look.length ? `, options=tr.RenderOptions(${look.join(", ")})` : "";
  return `import torchrender as tr

scene = tr.load(${JSON.stringify(name)})
camera = tr.Cameras.look_at(${tuple(eye)}, ${tuple(target)}, width=${width}, height=${height}, fov_deg=${degrees(walker.camera)})
tr.render(scene, camera${options}).save("view.png")
`;
}

/** The same as a command. */
export function commandText(walker, name, { ev, tone }) {
  const { eye, target } = placeOf(walker);
  const { width, height } = walker.camera;
  const list = (v) => v.join(",");
  const quoted = /^[\w./-]+$/.test(name) ? name : `'${name.replaceAll("'", "'\\''")}'`;
  const look = [ev === null ? null : `--exposure=${ev}`, tone === "none" ? null : `--tone-map ${tone}`].filter(Boolean);
  return ["torchrender render", quoted, `--camera eye=${list(eye)} target=${list(target)} fov=${degrees(walker.camera)}`, `--size ${width}x${height}`, ...look, "-o view.png"].join(" ");
}
