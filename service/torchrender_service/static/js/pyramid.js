// What lies around holes of any size: the warped picture averaged down to one pixel, and from there back up into what is
// not covered.

import { PULL_FRAGMENT, PUSH_FRAGMENT } from "./shaders.js";

export const FIRST = 4; // pixels along a side of the finest level's cells: holes narrower than two of them are filled without
const HALF = 2; // cells along a side of the next level's

export class Pyramid {
  /** `pass(fragment, uniforms)` makes a pass over all pixels, `buffer(width, height, textures)` what it draws into. */
  constructor(pass, buffer) {
    this.buffer = buffer;
    this.pull = pass(PULL_FRAGMENT, {
      finer: { value: null },
      coverage: { value: null },
      cell: { value: FIRST },
      weighted: { value: false },
    });
    this.push = pass(PUSH_FRAGMENT, { own: { value: null }, coverage: { value: null }, coarser: { value: null } });
    this.levels = [];
  }

  get passes() {
    return [this.pull, this.push];
  }

  resize(width, height) {
    for (const { pulled, filled } of this.levels) {
      pulled.dispose();
      filled?.dispose();
    }
    this.levels = [];
    for (let cell = FIRST; ; cell = HALF) {
      width = Math.ceil(width / cell);
      height = Math.ceil(height / cell);
      const last = width === 1 && height === 1;
      this.levels.push({ pulled: this.buffer(width, height, 2), filled: last ? null : this.buffer(width, height, 1) });
      if (last) return;
    }
  }

  /**
   * The finest level for a warped picture: colours, and how near they are; 0 where there is nothing at all.
   * `draw(pass, target)` draws.
   */
  build(warped, draw) {
    const { levels } = this;
    const pull = this.pull.uniforms;
    levels.forEach(({ pulled }, k) => {
      const [finer, coverage] = k ? levels[k - 1].pulled.textures : [warped, warped];
      pull.finer.value = finer;
      pull.coverage.value = coverage;
      pull.cell.value = k ? HALF : FIRST;
      pull.weighted.value = k > 0;
      draw(this.pull, pulled);
    });
    const push = this.push.uniforms;
    let coarser = levels.at(-1).pulled.textures[0];
    for (const { pulled, filled } of levels.slice(0, -1).reverse()) {
      [push.own.value, push.coverage.value] = pulled.textures;
      push.coarser.value = coarser;
      draw(this.push, filled);
      coarser = filled.texture;
    }
    return coarser;
  }
}
