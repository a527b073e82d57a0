// Which keyframes are kept and in what order they are drawn.

import { angleBetween, eyeOf, length, subtract } from "./camera.js";

const EARLIER = 3; // keyframes kept beside the newest; that of the start besides
const LAYERED = 2; // keyframes of which extra layers are drawn
const SAME_DISTANCE = 0.01; // of the typical depth: a keyframe this near to a newer one adds nothing
const SAME_ANGLE = 0.02; // radians
const SAME_VIEW = 0.2; // of both: nearer than that it is the same view; else it goes where a third one is as near
const BLUR_DISTANCE = 0.1; // of the typical depth: from here a keyframe looks half as sharp
const NEWEST_BONUS = 1.3; // its shading fits best
const REFINED_BONUS = 3; // made without haste, while pictures of a moving view may hold fewer samples than pixels

/** How many of the layers of a keyframe are there. */
export const received = (group) => 1 + group.extra.length + (group.picture.mirrors ? 1 : 0);

const sameNear = (a, b) => Math.abs(a - b) <= 1e-6 * b;

export class KeyframeSet {
  constructor() {
    this.warp = null; // holds the pictures; there before the first one
    this.groups = []; // newest first; each has its picture (layer 0), what its mirrors show, and extra layers
    this.leaving = []; // what is not kept any more, but still fades out
    this.cut = null; // the near plane that a program asked for: what was taken with another gives way to the first with it
    this.home = null; // the camera of the start: what was seen from there is kept, so that going back shows it at once
  }

  get newest() {
    return this.groups[0] ?? null;
  }

  /** Take a decoded image; returns its keyframe if the picture is new, null for an extra layer or a late arrival. */
  add(image) {
    const { id, layer, layers, camera } = image.header;
    const known = this.groups.find((group) => group.id === id);
    if (layer > 0) {
      if (!known) image.color.close();
      else if (image.header.mirrors) this.warp.addMirrors(known.picture, this.warp.add(image));
      else known.extra.push(this.warp.add(image));
      if (known === this.newest && known && received(known) === layers) this.dropRepeated(known);
      return null;
    }
    if (known) this.drop(known);
    // What a scene looked like at another time of its animation, or before its program changed it, is not there any more.
    const state = ({ scene_s = null, revision = 0 }) => `${scene_s} ${revision}`;
    for (const other of this.groups.filter((g) => state(g.header) !== state(image.header))) this.drop(other);
    if (this.cut !== null && sameNear(camera.near, this.cut)) {
      for (const other of this.groups.filter((g) => !sameNear(g.camera.near, this.cut))) this.drop(other);
      this.cut = null;
    }
    const group = { id, camera, typical: image.typical, header: image.header, picture: this.warp.add(image), extra: [] };
    this.groups.unshift(group);
    if (layers === 1) this.dropRepeated(group);
    const kept = this.atHome();
    const spare = () => this.order(camera).filter((g) => g !== kept);
    while (this.groups.length - (kept ? 1 : 0) > EARLIER + 1) this.drop(spare().findLast((g) => g !== group));
    return group;
  }

  /** The finest keyframe from the start. */
  atHome() {
    const { home } = this;
    if (!home) return null;
    const there = this.groups.filter((g) => this.samePlace(g.camera, home, g.typical));
    return there.sort((a, b) => this.fineness(b) - this.fineness(a))[0] ?? null;
  }

  samePlace(a, b, typical, share = 1) {
    const step = length(subtract(eyeOf(a), eyeOf(b)));
    return step < share * SAME_DISTANCE * typical && angleBetween(a, b) < share * SAME_ANGLE;
  }

  /** Settings have changed: what was there before gives way to what comes. */
  outdate() {
    for (const group of this.groups) group.outdated = true;
  }

  /**
   * Earlier keyframes from nearly the same place hold nothing that a complete newer one lacks, unless they are finer.
   * Where keyframes follow each other closely, some of them stay, so that a trail of the way is there.
   */
  dropRepeated(group) {
    const { typical } = group;
    const finer = (other) => !other.outdated && this.fineness(other) > 1.01 * this.fineness(group);
    const near = (a, b, share) => this.samePlace(a.camera, b.camera, typical, share);
    const needless = (other) => this.groups.some((g) => g !== group && g !== other && near(g, other));
    for (const other of this.groups.filter((g) => g !== group && near(g, group) && !finer(g)))
      if (near(other, group, SAME_VIEW) || other.outdated || needless(other)) this.drop(other);
  }

  fineness(group) {
    return group.camera.fx * (group.header.still ? REFINED_BONUS : 1);
  }

  /** How well a keyframe looks from `view`: by its pixels, less the farther away it was taken. */
  sharpness(group, view) {
    const step = length(subtract(eyeOf(group.camera), eyeOf(view))) / (BLUR_DISTANCE * group.typical);
    const bonus = group === this.newest ? NEWEST_BONUS : 1;
    return group.outdated ? 0 : (bonus * this.fineness(group)) / (1 + step * step);
  }

  /** Keyframes in the order of preference. */
  order(view) {
    const sharp = new Map(this.groups.map((group) => [group, this.sharpness(group, view)]));
    return [...this.groups].sort((a, b) => sharp.get(b) - sharp.get(a));
  }

  drop(group) {
    this.groups = this.groups.filter((other) => other !== group);
    this.leaving.push(group.picture, ...group.extra);
  }

  /** Free what nothing shows any more; `shown` are pictures that still fade out. */
  sweep(shown = []) {
    const gone = this.leaving.filter((picture) => !shown.includes(picture));
    for (const picture of gone) this.warp.remove(picture);
    this.leaving = this.leaving.filter((picture) => shown.includes(picture));
  }

  clear() {
    for (const group of [...this.groups]) this.drop(group);
    this.sweep();
  }

  /** Pictures to draw, the preferred first: keyframes, at most `most` beside it, then extra layers of the first ones. */
  pictures(view, { earlier = true, layers = true, most = EARLIER } = {}) {
    const groups = earlier ? this.order(view).slice(0, most + 1) : this.groups.slice(0, 1);
    const extra = layers ? groups.slice(0, LAYERED).flatMap((group) => group.extra) : [];
    return [...groups.map((group) => group.picture), ...extra];
  }
}
