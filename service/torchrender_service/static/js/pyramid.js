// What lies around holes of any size: the warped picture averaged down to one pixel, and from there back up into what is
// not covered.

import { PULL_FRAGMENT, PUSH_FRAGMENT } from "./shaders.js";

export const FIRST = 4; // pixels along a side of the finest level's cells: holes narrower than two of them are filled without
const HALF = 2; // cells along a side of the next level's

// How much farther surfaces are preferred: fully by what comes out from behind something, which is narrow. What is wider
// lies beyond the picture's edge, where the sky is no likelier than what is nearer.
export const PREFERENCE = 24;
const NARROW = 2; // the coarsest level of full preference: cells of 16 pixels
const WANE = 3; // by which it is less from level to level
const preferenceAt = (level) => PREFERENCE * Math.min(1, WANE ** (NARROW - level));

export class Pyramid {
  /** `pass(fragment, uniforms)` makes a pass over all pixels, `buffer(width, height, textures)` what it draws into. */
  constructor(pass, buffer) {
    this.buffer = buffer;
    this.pull = pass(PULL_FRAGMENT, {
      finer: { value: null },
      coverage: { value: null },
      cell: { value: FIRST },
      preference: { value: PREFERENCE },
      weighted: { value: false },
    });
    this.push = pass(PUSH_FRAGMENT, {
      own: { value: null },
      coverage: { value: null },
      coarser: { value: null },
      preference: { value: PREFERENCE },
    });
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
      pull.preference.value = preferenceAt(k);
      draw(this.pull, pulled);
    });
    const push = this.push.uniforms;
    let coarser = levels.at(-1).pulled.textures[0];
    for (let k = levels.length - 2; k >= 0; k--) {
      const { pulled, filled } = levels[k];
      [push.own.value, push.coverage.value] = pulled.textures;
      push.coarser.value = coarser;
      push.preference.value = preferenceAt(k);
      draw(this.push, filled);
      coarser = filled.texture;
    }
    return coarser;
  }
}
