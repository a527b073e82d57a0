// Unpacks keyframe messages off the main thread: checksum, zstd, prediction, quads, colour.

import { ZSTDDecoder } from "../vendor/zstddec/zstddec.mjs";
import { undoPrediction, unpackBits } from "./depth-codec.js";
import { MISSING, buildQuads } from "./surface.js";
import { crc32, decodeMessage } from "./wire.js";

const zstd = new ZSTDDecoder();
const ready = zstd.init();

function inflate(bytes, size) {
  const out = zstd.decode(bytes, size);
  if (out.length !== size) throw new Error(`zstd gave ${out.length} bytes instead of ${size}`);
  return out;
}

/** Codes with MISSING where the mask says that there is no sample. */
function decodeDepth(header, blobs) {
  const { width, height } = header.camera;
  if (header.depth.codec !== "pz1") throw new Error(`depth codec ${header.depth.codec} is not known`);
  const codes = undoPrediction(inflate(blobs.depth, 2 * width * height), width, height);
  const present = blobs.mask && unpackBits(inflate(blobs.mask, ((width + 7) >> 3) * height), width, height);
  for (let i = 0; i < codes.length; i++) {
    if (present && !present[i]) codes[i] = MISSING;
    else if (codes[i] === MISSING) codes[i] = MISSING - 1; // the nearest depth, one step of quantisation off
  }
  return codes;
}

/** Harmonic mean of the depths: how far things are for which parallax matters; infinite where there is only sky. */
function typicalDepth(codes, scale) {
  let sum = 0;
  let count = 0;
  for (let i = 0; i < codes.length; i += 7) {
    if (codes[i] === MISSING || codes[i] === 0) continue;
    sum += codes[i];
    count++;
  }
  return sum > 0 ? count / (sum * scale) : Infinity;
}

async function decodeKeyframe(buffer, maxPixels) {
  const begin = performance.now();
  const { header, blobs, payload } = decodeMessage(buffer);
  const { width, height, fx, fy } = header.camera;
  if (!(width > 0 && height > 0 && width * height <= maxPixels)) throw new Error(`keyframe of ${width} x ${height}`);
  if (crc32(payload) !== header.crc32) throw new Error("checksum does not match");
  await ready;
  const type = `image/${header.color.codec}`;
  const options = { colorSpaceConversion: "none", premultiplyAlpha: "none" };
  const picture = createImageBitmap(new Blob([blobs.color], { type }), options);
  const codes = decodeDepth(header, blobs);
  const scale = 1 / (((1 << header.depth.bits) - 1) * header.depth.near);
  const unpacked = performance.now();
  const quads = buildQuads(codes, width, height, scale, Math.min(fx, fy));
  const built = performance.now();
  const color = await picture;
  if (color.width !== width || color.height !== height) throw new Error(`colour of ${color.width} x ${color.height}`);
  const times = { decode: unpacked - begin, quads: built - unpacked, all: performance.now() - begin };
  const typical = typicalDepth(codes, scale);
  return { header, codes, scale, quads, typical, color, times, bytes: buffer.byteLength };
}

async function answer({ serial, buffer, maxPixels }) {
  try {
    const image = await decodeKeyframe(buffer, maxPixels);
    const quads = image.quads;
    self.postMessage({ serial, image }, [image.codes.buffer, quads.data.buffer, quads.joined.buffer, image.color]);
  } catch (error) {
    self.postMessage({ serial, error: String(error.message ?? error) });
  }
}

// One after the other: colours take unequal times, and layer 0 must not be overtaken.
let last = Promise.resolve();
self.onmessage = ({ data }) => {
  last = last.then(() => answer(data));
};
