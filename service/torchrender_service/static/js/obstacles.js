// What is in the way of somebody who walks: cells of a grid that a surface meets.

import { add, length, scale } from "./camera.js";

const REACH = 0.8; // cells between the eye and a wall
const SUBSTEP = 0.5; // cells
const OFFSETS = [-1, 0, 1].flatMap((x) => [-1, 0, 1].flatMap((y) => [-1, 0, 1].map((z) => [x, y, z])));

export class Obstacles {
  /** `obstacles` of GET /v1/scenes/{id}/survey. */
  constructor({ origin, cell, dims, bits }) {
    this.origin = origin;
    this.cell = cell;
    this.dims = dims;
    this.bits = Uint8Array.from(atob(bits), (c) => c.charCodeAt(0));
  }

  /** Whether a surface meets the cell around a point; outside the grid there is none. */
  filled(point) {
    const [i, j, k] = point.map((v, n) => Math.floor((v - this.origin[n]) / this.cell));
    const [nx, ny, nz] = this.dims;
    if (i < 0 || j < 0 || k < 0 || i >= nx || j >= ny || k >= nz) return false;
    const number = i + nx * (j + ny * k);
    return ((this.bits[number >> 3] >> (number & 7)) & 1) === 1;
  }

  /** Whether anything is within `reach` cells of a point. */
  blocked(point, reach) {
    return reach === 0 ? this.filled(point) : OFFSETS.some((way) => this.filled(add(point, scale(way, reach * this.cell))));
  }

  /** Where a step from `eye` ends: before what is in the way, along it where the step goes aside. */
  move(eye, step) {
    // Whoever stands close to something may go on to do so; whoever is inside gets out freely.
    const reach = [REACH, REACH / 2, 0].find((r) => !this.blocked(eye, r));
    if (reach === undefined) return add(eye, step);
    const count = Math.max(1, Math.ceil(length(step) / (SUBSTEP * this.cell)));
    const part = scale(step, 1 / count);
    let at = eye;
    for (let k = 0; k < count; k++) {
      const next = add(at, part);
      if (!this.blocked(next, reach)) {
        at = next;
        continue;
      }
      const start = at;
      for (const axis of [0, 1, 2]) {
        const aside = at.map((v, n) => (n === axis ? v + part[n] : v));
        if (part[axis] !== 0 && !this.blocked(aside, reach)) at = aside;
      }
      if (at === start) break;
    }
    return at;
  }
}
