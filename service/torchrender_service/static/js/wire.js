// Messages of the protocol torchrender.v1: "TRDI", version, type, flags, header length, msgpack header, blobs.

import { decode, encode } from "../vendor/msgpack/index.mjs";

export const PROTOCOL = "torchrender.v1";
export const MAJOR = 1;
export const TYPE = Object.freeze({
  HELLO: 1,
  WELCOME: 2,
  POSE: 3,
  KEYFRAME: 4,
  ACK: 5,
  RESYNC: 6,
  ERROR: 7,
  BYE: 8,
  SETTINGS: 9,
  STATUS: 10,
  LOOK: 11,
  PICK: 12,
  PICKED: 13,
});

const PREFIX = 12;
const MAGIC = 0x49445254; // "TRDI", little endian
const MAX_HEADER = 1 << 20;
// Header fields that tell the length of a blob, in the order of the blobs.
const BLOBS = ["depth", "color", "mask"];

export class WireError extends Error {}

const padded = (length) => (length + 7) & ~7;

/** One message without blobs, as a browser sends them. */
export function encodeMessage(type, header) {
  const packed = encode(header);
  const message = new Uint8Array(padded(PREFIX + packed.length));
  const view = new DataView(message.buffer);
  view.setUint32(0, MAGIC, true);
  view.setUint8(4, MAJOR);
  view.setUint8(5, type);
  view.setUint16(6, 0, true);
  view.setUint32(8, packed.length, true);
  message.set(packed, PREFIX);
  return message;
}

/**
 * Type, header, blobs (by name, as views of `buffer`) and all bytes from the first blob on, which the checksum covers.
 * Throws WireError where the message is not sound.
 */
export function decodeMessage(buffer) {
  if (buffer.byteLength < PREFIX) throw new WireError(`message of ${buffer.byteLength} bytes is too short`);
  const view = new DataView(buffer);
  if (view.getUint32(0, true) !== MAGIC) throw new WireError("message does not start with TRDI");
  if (view.getUint8(4) !== MAJOR) throw new WireError(`protocol version ${view.getUint8(4)} is not ${MAJOR}`);
  const type = view.getUint8(5);
  const length = view.getUint32(8, true);
  if (length > MAX_HEADER || PREFIX + length > buffer.byteLength) throw new WireError(`header of ${length} bytes`);
  const header = decode(new Uint8Array(buffer, PREFIX, length));
  const start = Math.min(padded(PREFIX + length), buffer.byteLength);
  const blobs = type === TYPE.KEYFRAME ? sliceBlobs(buffer, start, header) : {};
  return { type, header, blobs, payload: new Uint8Array(buffer, start) };
}

function sliceBlobs(buffer, start, header) {
  const blobs = {};
  let offset = start;
  for (const name of BLOBS) {
    const length = header[name]?.length;
    if (length === undefined) continue;
    if (!Number.isInteger(length) || length < 0 || offset + length > buffer.byteLength)
      throw new WireError(`${name} of ${length} bytes does not fit into the message`);
    blobs[name] = new Uint8Array(buffer, offset, length);
    offset += padded(length);
  }
  return blobs;
}

const CRC = new Uint32Array(256).map((_, n) => {
  for (let bit = 0; bit < 8; bit++) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
  return n;
});

/** CRC-32, as zlib computes it. */
export function crc32(bytes) {
  let crc = 0xffffffff;
  for (let i = 0; i < bytes.length; i++) crc = CRC[(crc ^ bytes[i]) & 255] ^ (crc >>> 8);
  return (crc ^ 0xffffffff) >>> 0;
}
