// Pinhole cameras as the protocol has them: x right, y down, z forward, `world_from_camera` row by row.

/** Rotation part (9 numbers, row by row) and eye of a camera. */
function parts(camera) {
  const m = camera.world_from_camera;
  return {
    turn: [m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]],
    eye: [m[3], m[7], m[11]],
  };
}

function inverse3(m) {
  const [a, b, c, d, e, f, g, h, i] = m;
  const A = e * i - f * h;
  const B = f * g - d * i;
  const C = d * h - e * g;
  const scale = 1 / (a * A + b * B + c * C);
  return [A, c * h - b * i, b * f - c * e, B, a * i - c * g, c * d - a * f, C, b * g - a * h, a * e - b * d].map(
    (v) => v * scale,
  );
}

function multiply3(a, b) {
  const out = new Array(9);
  for (let r = 0; r < 3; r++)
    for (let c = 0; c < 3; c++) out[3 * r + c] = a[3 * r] * b[c] + a[3 * r + 1] * b[3 + c] + a[3 * r + 2] * b[6 + c];
  return out;
}

const apply3 = (m, v) => [0, 3, 6].map((r) => m[r] * v[0] + m[r + 1] * v[1] + m[r + 2] * v[2]);

/**
 * The matrix M (16 numbers, column by column) with clip position = M (u, v, 1, 1/z), for samples at pixel (u, v) and
 * depth z of `source`, seen by `target`. Infinite depth is 1/z = 0. Depth in the buffer is 1 - near (1 - bias) / depth,
 * so that `bias` puts a picture behind others that show the same surface.
 */
export function clipFromSource(source, target, near, bias) {
  const from = parts(source);
  const to = parts(target);
  const back = inverse3(to.turn);
  const unproject = [1 / source.fx, 0, -source.cx / source.fx, 0, 1 / source.fy, -source.cy / source.fy, 0, 0, 1];
  const turn = multiply3(multiply3(back, from.turn), unproject);
  const shift = apply3(back, [0, 1, 2].map((k) => from.eye[k] - to.eye[k]));
  const rows = [0, 1, 2].map((r) => [turn[3 * r], turn[3 * r + 1], turn[3 * r + 2], shift[r]]);
  const [x, y, z] = rows;
  const clip = [
    x.map((v, k) => (2 / target.width) * (target.fx * v + target.cx * z[k]) - z[k]),
    y.map((v, k) => z[k] - (2 / target.height) * (target.fy * v + target.cy * z[k])),
    z.map((v, k) => v - (k === 3 ? 2 * near * (1 - bias) : 0)),
    z,
  ];
  return [0, 1, 2, 3].flatMap((column) => clip.map((row) => row[column]));
}

export const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const length = (v) => Math.hypot(v[0], v[1], v[2]);
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const scale = (v, s) => [v[0] * s, v[1] * s, v[2] * s];
export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const normalize = (v) => scale(v, 1 / (length(v) || 1));

/** Where pixel (x, y) of `view` lies in a picture of `source`: at (left + across x, top + down y). */
export function pixelsBetween(view, source) {
  const across = source.fx / view.fx;
  const down = source.fy / view.fy;
  return { left: source.cx - across * view.cx, across, top: source.cy - down * view.cy, down };
}

/** Pixels of `view`, at most, by which `source` shows what is as near as `nearest` at another place than it does. */
export function shiftBetween(view, source, nearest) {
  const [to, from] = [parts(view), parts(source)];
  const turned = Math.max(...from.turn.map((v, k) => Math.abs(v - to.turn[k])));
  return view.fx * (turned + length(subtract(from.eye, to.eye)) / nearest);
}

export const eyeOf = (camera) => parts(camera).eye;
/** Right, down and forward axes of a camera in the world. */
export const axesOf = (camera) => {
  const m = camera.world_from_camera;
  return [0, 1, 2].map((k) => [m[k], m[4 + k], m[8 + k]]);
};

/** The camera with another eye and other axes (right, down, forward). */
export function placed(camera, eye, [right, down, forward]) {
  const rows = [0, 1, 2].flatMap((k) => [right[k], down[k], forward[k], eye[k]]);
  return { ...camera, world_from_camera: [...rows, 0, 0, 0, 1] };
}

/** `v` turned by `angle` about the unit vector `axis`. */
export function rotate(v, axis, angle) {
  const cos = Math.cos(angle);
  const part = scale(axis, dot(axis, v) * (1 - cos));
  return add(add(scale(v, cos), scale(cross(axis, v), Math.sin(angle))), part);
}

/** Angle between the directions in which two cameras look. */
export function angleBetween(a, b) {
  const cos = dot(normalize(axesOf(a)[2]), normalize(axesOf(b)[2]));
  return Math.acos(Math.min(1, Math.max(-1, cos)));
}
