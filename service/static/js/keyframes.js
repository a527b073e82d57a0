// Which keyframes are kept and in what order they are drawn.

import { angleBetween, eyeOf, length, subtract } from "./camera.js";

const EARLIER = 3; // keyframes kept beside the newest
const SAME_DISTANCE = 0.004; // of the scene's diagonal: a keyframe this near to a newer one adds nothing
const SAME_ANGLE = 0.02; // radians

export class KeyframeSet {
  constructor(warp) {
    this.warp = warp;
    this.groups = []; // newest first; each has its picture (layer 0) and extra layers
    this.diagonal = 1;
  }

  get newest() {
    return this.groups[0] ?? null;
  }

  /** Take a decoded image; returns its keyframe if the picture is new, null for an extra layer or a late arrival. */
  add(image) {
    const { id, layer, layers, still, camera } = image.header;
    const known = this.groups.find((group) => group.id === id);
    if (layer > 0) {
      if (known) known.extra.push(this.warp.add(image));
      else image.color.close();
      if (known === this.newest && known?.extra.length === layers - 1) this.dropRepeated(known);
      return null;
    }
    if (known) this.drop(known);
    const group = { id, still, camera, header: image.header, picture: this.warp.add(image), extra: [] };
    this.groups.unshift(group);
    if (layers === 1) this.dropRepeated(group);
    while (this.groups.length > EARLIER + 1) this.drop(this.farthest());
    return group;
  }

  /** Earlier keyframes from nearly the same place hold nothing that a complete newer one lacks. */
  dropRepeated(group) {
    for (const other of this.groups.filter((g) => g !== group && this.distance(g.camera, group.camera) < 1)) this.drop(other);
  }

  /** 1 where cameras are so far apart that both are worth keeping. */
  distance(a, b) {
    const step = length(subtract(eyeOf(a), eyeOf(b))) / (SAME_DISTANCE * this.diagonal);
    return Math.max(step, angleBetween(a, b) / SAME_ANGLE);
  }

  farthest() {
    const from = this.newest.camera;
    return this.groups.slice(1).reduce((a, b) => (this.distance(b.camera, from) >= this.distance(a.camera, from) ? b : a));
  }

  drop(group) {
    this.groups = this.groups.filter((other) => other !== group);
    for (const picture of [group.picture, ...group.extra]) this.warp.remove(picture);
  }

  clear() {
    for (const group of [...this.groups]) this.drop(group);
  }

  /** Pictures to draw, the preferred first: newest keyframe, earlier ones, extra layers from new to old. */
  pictures({ earlier = true, layers = true } = {}) {
    const groups = earlier ? this.groups : this.groups.slice(0, 1);
    return [...groups.map((g) => g.picture), ...(layers ? groups.flatMap((g) => g.extra) : [])];
  }
}
