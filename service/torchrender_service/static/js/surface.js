// Quads that stand for the samples of a depth image: each sample reaches to the corners of its pixel along its own
// tangent plane, neighbours on one surface share their corners, and flat blocks of samples become one quad. Planes are
// linear in 1/z over the image, so all of this is linear arithmetic on the codes.

const SLOPE_LIMIT = 1.1; // a corner lies within this factor of its sample's depth
// The tolerances of the Python reconstruction (torchrender/geometry/corners.py), so that both draw the same surfaces.
const JOIN_FOOTPRINTS = 2; // corners closer than this many pixel widths are of one surface
const JOIN_SLOPE = 0.5; // ... or than this share of the tangent plane's own change
const THIN = 0.02; // share of 1/z by which all neighbours must be farther, or nearer, for a sample to stand alone
const ROUNDING = 1.5; // codes by which rounding may tear apart two corners
// Pixel widths by which a sample may lie off the quad of its block: an eye that moves by a twentieth of the distance
// then sees it 0.06 pixels off.
const FLAT_FOOTPRINTS = 1.2;
const FLAT_CODES = 1.0;
const LARGEST = 16; // pixels along a side of a block
// Pixels by which blocks overlap their neighbours, so that such errors and rounding leave no cracks between them. Single
// quads share their corners to the bit and need none.
const BLOCK_OVERLAP = 0.05;
export const MISSING = 65535; // code of a pixel without sample

const beyond = (code) => code === MISSING || code === 0; // no sample, or sky: no surface that a slope could lead to

/** The change of 1/z per pixel of one surface through three neighbours, of which the outer two may be missing. */
function slope(before, own, after) {
  const left = own - before;
  const right = after - own;
  const most = THIN * own;
  if (beyond(before)) return beyond(after) || Math.abs(right) > most ? 0 : right;
  if (beyond(after)) return Math.abs(left) > most ? 0 : left;
  const small = Math.min(Math.abs(left), Math.abs(right));
  if (Math.abs(left - right) <= ROUNDING + 0.5 * small) return 0.5 * (left + right);
  if (left * right < 0 && small > most) return 0; // a cord: neither neighbour is of its surface
  return Math.abs(left) < Math.abs(right) ? left : right;
}

/** Corner codes (4 per pixel: upper left, lower left, lower right, upper right) along each sample's tangent plane. */
function guessCorners(codes, width, height) {
  const corners = new Float32Array(4 * width * height);
  for (let y = 0, i = 0; y < height; y++) {
    for (let x = 0; x < width; x++, i++) {
      const own = codes[i];
      if (beyond(own)) continue; // corners of the sky are 0, too
      const across = 0.5 * slope(x > 0 ? codes[i - 1] : MISSING, own, x + 1 < width ? codes[i + 1] : MISSING);
      const down = 0.5 * slope(y > 0 ? codes[i - width] : MISSING, own, y + 1 < height ? codes[i + width] : MISSING);
      const least = own / SLOPE_LIMIT;
      const most = own * SLOPE_LIMIT;
      corners[4 * i] = Math.min(most, Math.max(least, own - across - down));
      corners[4 * i + 1] = Math.min(most, Math.max(least, own - across + down));
      corners[4 * i + 2] = Math.min(most, Math.max(least, own + across + down));
      corners[4 * i + 3] = Math.min(most, Math.max(least, own + across - down));
    }
  }
  return corners;
}

/**
 * Let the pixels around each image corner that lie on one surface share the mean of their guesses. Returns who shares
 * each of the (width + 1) x (height + 1) corners: bits 2k and 2k + 1 hold the group of the upper left, upper right, lower
 * left and lower right pixel.
 */
function joinCorners(codes, corners, width, height, focal) {
  const joined = new Uint8Array((width + 1) * (height + 1)); // 0: all four
  const near = JOIN_FOOTPRINTS / focal;
  const slots = [0, 0, 0, 0]; // where the four guesses around a corner are kept; -1 where there is no sample
  for (let y = 0; y <= height; y++) {
    for (let x = 0; x <= width; x++) {
      const base = y * width + x;
      const inside = y > 0 && y < height && x > 0 && x < width;
      if (inside && joinAll(codes, corners, base - width - 1, base - 1, base, base - width, near)) continue;
      // In a ring: upper left pixel (its corner 2), lower left (3), lower right (0), upper right (1).
      slots[0] = y > 0 && x > 0 && codes[base - width - 1] !== MISSING ? 4 * (base - width - 1) + 2 : -1;
      slots[1] = y < height && x > 0 && codes[base - 1] !== MISSING ? 4 * (base - 1) + 3 : -1;
      slots[2] = y < height && x < width && codes[base] !== MISSING ? 4 * base : -1;
      slots[3] = y > 0 && x < width && codes[base - width] !== MISSING ? 4 * (base - width) + 1 : -1;
      joinGroups(codes, corners, slots, near);
      joined[y * (width + 1) + x] = group[0] | (group[3] << 2) | (group[1] << 4) | (group[2] << 6);
    }
  }
  return joined;
}

/** The common cases, quickly: there is no sample, or all four guesses agree. Tells whether that is so. */
function joinAll(codes, corners, a, b, c, d, near) {
  if (codes[a] === MISSING || codes[b] === MISSING || codes[c] === MISSING || codes[d] === MISSING)
    return codes[a] === MISSING && codes[b] === MISSING && codes[c] === MISSING && codes[d] === MISSING;
  const va = corners[4 * a + 2];
  const vb = corners[4 * b + 3];
  const vc = corners[4 * c];
  const vd = corners[4 * d + 1];
  const spread = Math.max(va, vb, vc, vd) - Math.min(va, vb, vc, vd);
  if (spread > ROUNDING + near * Math.min(codes[a], codes[b], codes[c], codes[d])) return false;
  const mean = 0.25 * (va + vb + vc + vd);
  corners[4 * a + 2] = mean;
  corners[4 * b + 3] = mean;
  corners[4 * c] = mean;
  corners[4 * d + 1] = mean;
  return true;
}

const group = [0, 1, 2, 3];
const value = new Float64Array(4);

/** Pixels whose guesses agree become one group, by way of others, too; every group takes its mean. */
function joinGroups(codes, corners, slots, near) {
  for (let k = 0; k < 4; k++) {
    group[k] = k;
    value[k] = slots[k] < 0 ? 0 : corners[slots[k]];
  }
  for (let k = 0; k < 4; k++) {
    for (let next = k + 1; next < 4; next++) {
      if (slots[k] < 0 || slots[next] < 0 || group[k] === group[next]) continue;
      const own = codes[slots[k] >> 2];
      const other = codes[slots[next] >> 2];
      const change = Math.min(Math.abs(value[k] - own), Math.abs(value[next] - other));
      const limit = ROUNDING + near * Math.min(own, other) + JOIN_SLOPE * change;
      if (Math.abs(value[k] - value[next]) > limit) continue;
      const old = group[next];
      for (let m = 0; m < 4; m++) if (group[m] === old) group[m] = group[k];
    }
  }
  for (let k = 0; k < 4; k++) {
    if (slots[k] < 0) continue;
    let sum = 0;
    let count = 0;
    for (let m = 0; m < 4; m++)
      if (slots[m] >= 0 && group[m] === group[k]) {
        sum += value[m];
        count++;
      }
    corners[slots[k]] = sum / count;
  }
}

/** Growing list of quads: four corners, each u, v, 1/z. */
class QuadList {
  constructor(capacity) {
    this.data = new Float32Array(12 * capacity);
    this.count = 0;
    this.end = 0;
  }

  add(x, y, size, a, b, c, d, scale) {
    if (12 * (this.count + 1) > this.data.length) {
      const grown = new Float32Array(2 * this.data.length);
      grown.set(this.data);
      this.data = grown;
    }
    const overlap = size === 1 ? 0 : BLOCK_OVERLAP;
    const e = overlap / size;
    const low = -overlap;
    const high = size + overlap;
    this.corner(x + low, y + low, scale * (a + e * (2 * a - b - d)));
    this.corner(x + low, y + high, scale * (b + e * (2 * b - a - c)));
    this.corner(x + high, y + high, scale * (c + e * (2 * c - b - d)));
    this.corner(x + high, y + low, scale * (d + e * (2 * d - a - c)));
    this.count++;
  }

  corner(u, v, inverse) {
    this.data[this.end++] = u;
    this.data[this.end++] = v;
    this.data[this.end++] = Math.max(0, inverse);
  }
}

/** Whether the block of `size` pixels at (x, y) is one plane to within `tolerance`, a share of 1/z. */
function isFlat(codes, corners, width, x, y, size, tolerance) {
  const first = y * width + x;
  const last = first + (size - 1) * width;
  if (codes[first] === MISSING || codes[last + size - 1] === MISSING) return false;
  const a = corners[4 * first];
  const b = corners[4 * last + 1];
  const c = corners[4 * (last + size - 1) + 2];
  const d = corners[4 * (first + size - 1) + 3];
  if (Math.abs(a + c - b - d) > FLAT_CODES + tolerance * Math.max(a, c)) return false;
  const across = (d - a + c - b) / (2 * size);
  const down = (b - a + c - d) / (2 * size);
  const start = 0.25 * (a + b + c + d) - 0.5 * (size - 1) * (across + down);
  for (let row = 0; row < size; row++) {
    for (let column = 0, i = first + row * width; column < size; column++, i++) {
      const code = codes[i];
      const expected = start + row * down + column * across;
      if (code === MISSING || Math.abs(code - expected) > FLAT_CODES + tolerance * code) return false;
    }
  }
  return true;
}

/**
 * Quads of a depth image: `data` holds u, v (source pixels) and 1/z of four corners each, `count` is their number,
 * `joined` tells which pixels around a corner are of one surface, see `joinCorners`.
 *
 * `codes` are inverse depths near/z times `levels`, MISSING where there is no sample; `scale` is 1/z of code 1; `focal`
 * the focal length in pixels.
 */
export function buildQuads(codes, width, height, scale, focal) {
  const corners = guessCorners(codes, width, height);
  const joined = joinCorners(codes, corners, width, height, focal);
  const tolerance = FLAT_FOOTPRINTS / focal;
  const quads = new QuadList(Math.max(1024, (width * height) >> 3));
  const visit = (x, y, size) => {
    if (size === 1) {
      const i = y * width + x;
      if (codes[i] === MISSING) return;
      const c = 4 * i;
      quads.add(x, y, 1, corners[c], corners[c + 1], corners[c + 2], corners[c + 3], scale);
    } else if (x + size <= width && y + size <= height && isFlat(codes, corners, width, x, y, size, tolerance)) {
      const last = (y + size - 1) * width + x;
      const a = corners[4 * (y * width + x)];
      const d = corners[4 * (y * width + x + size - 1) + 3];
      quads.add(x, y, size, a, corners[4 * last + 1], corners[4 * (last + size - 1) + 2], d, scale);
    } else {
      const half = size >> 1;
      const right = x + half < width;
      const below = y + half < height;
      visit(x, y, half);
      if (right) visit(x + half, y, half);
      if (below) visit(x, y + half, half);
      if (right && below) visit(x + half, y + half, half);
    }
  };
  for (let y = 0; y < height; y += LARGEST) for (let x = 0; x < width; x += LARGEST) visit(x, y, LARGEST);
  return { data: quads.data.slice(0, 12 * quads.count), count: quads.count, joined };
}
