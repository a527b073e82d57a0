// Several files as one ZIP archive, as they are: pictures and meshes are sent as they lie on the disk.

import { crc32 } from "./wire.js";

const LOCAL = 0x04034b50;
const CENTRAL = 0x02014b50;
const END = 0x06054b50;
const UTF8 = 0x0800;
const DATE = 0x21; // 1 January 1980: the same files make the same archive

function record(size, fill) {
  const view = new DataView(new ArrayBuffer(size));
  let at = 0;
  const u16 = (v) => view.setUint16((at += 2) - 2, v, true);
  const u32 = (v) => view.setUint32((at += 4) - 4, v, true);
  fill(u16, u32);
  return new Uint8Array(view.buffer);
}

/** A Blob of `files`: [path, File] pairs. */
export async function zip(files) {
  const parts = [];
  const list = [];
  let offset = 0;
  for (const [path, file] of [...files].sort((a, b) => (a[0] < b[0] ? -1 : 1))) {
    const name = new TextEncoder().encode(path);
    const data = new Uint8Array(await file.arrayBuffer());
    const crc = crc32(data);
    const facts = (u16, u32) => {
      for (const v of [20, UTF8, 0, 0, DATE]) u16(v);
      for (const v of [crc, data.length, data.length]) u32(v);
      u16(name.length);
      u16(0);
    };
    const head = record(30, (u16, u32) => (u32(LOCAL), facts(u16, u32)));
    const start = offset;
    list.push(
      record(46, (u16, u32) => {
        u32(CENTRAL);
        u16(20);
        facts(u16, u32);
        for (const v of [0, 0, 0]) u16(v);
        u32(0);
        u32(start);
      }),
      name,
    );
    parts.push(head, name, data);
    offset += head.length + name.length + data.length;
  }
  const size = list.reduce((sum, part) => sum + part.length, 0);
  const count = list.length / 2;
  const end = record(22, (u16, u32) => {
    u32(END);
    for (const v of [0, 0, count, count]) u16(v);
    u32(size);
    u32(offset);
    u16(0);
  });
  return new Blob([...parts, ...list, end], { type: "application/zip" });
}
