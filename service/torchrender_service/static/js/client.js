// The thin client: a stream of keyframes in, a picture of the newest pose out, every animation frame.

import { Decoder } from "./decoder.js";
import { Health } from "./health.js";
import { KeyframeSet } from "./keyframes.js";
import { Median, Rate, Smooth } from "./meter.js";
import { MAX_PIXELS, Stream } from "./stream.js";
import { Warp } from "./warp.js";
import { TYPE } from "./wire.js";

const POSE_INTERVAL = 50; // ms between poses
const HOLES_INTERVAL = 250; // ms between readings of the hole share
const FIGURES_INTERVAL = 250; // ms between two looks at how everything is
const EXPOSURE_EASE = 0.12; // seconds in which an automatic exposure takes effect
const SAME_EV = 0.004;
const FORESEEN = 0.1; // seconds ahead, at least, for which a pose says where the view goes
const FADE = 140; // ms from one keyframe to the next
const SLOW = 50; // ms of a frame from which on more frames are worth more than a fade and many earlier keyframes
const CLIP_SHARE = 0.002; // of the scene's diagonal: what is nearer is cut off,
const CLIP_SAMPLE = 0.1; // unless something of the newest picture is about as near: of its nearest sample's depth

const identical = (a, b) =>
  a !== null && b !== null && a.near === b.near && a.world_from_camera.every((v, k) => v === b.world_from_camera[k]);

export class Client {
  /**
   * `hooks`: state(name, detail), keyframe(header), frame(ms), figures(stats), sources() of the samples to draw,
   * exposure() to show (EV, or null: as the pictures come), scene(facts), picked(found), moved(), context(lost),
   * refused(problem) of what the server does not do, unable(error) where the browser has no WebGL2.
   */
  constructor(canvas, walker, hooks) {
    this.canvas = canvas;
    this.walker = walker;
    this.hooks = hooks;
    this.warp = null; // made while the first keyframe is decoded
    this.keyframes = new KeyframeSet();
    this.decoder = new Decoder();
    this.stream = new Stream({
      state: (name, detail) => this.onState(name, detail),
      welcome: (header, session) => this.onWelcome(header, session),
      keyframe: (buffer) => this.onKeyframe(buffer),
      problem: (header) => this.hooks.refused(header),
      told: (type, header) => this.onTold(type, header),
    });
    this.health = new Health(this);
    this.ev = null; // the exposure that is shown
    this.picks = 0;
    this.state = "closed";
    this.lost = false;
    this.acks = [];
    this.moving = false;
    this.pose = { seq: 0, sent: 0, camera: null, moving: false };
    this.traffic = new Rate();
    this.figures = { frame: new Smooth(), warp: new Smooth(), decode: new Smooth(), latency: new Median() };
    this.counts = { keyframes: 0, images: 0, frames: 0, drawn: 0, errors: 0, resyncs: 0 };
    this.holes = null;
    this.stretched = null;
    this.holesAt = 0;
    this.figuresAt = 0;
    this.holesOf = 0; // the picture that was measured, by its number
    this.views = 0; // scenes that were begun: figures of one say nothing about the next
    this.dirty = true;
    this.settings = null; // what the user wishes for, as SETTINGS holds it; null: nothing
    this.seq = 0; // of the newest SETTINGS
    this.drawn = []; // pictures of the last frame
    this.fade = null; // pictures that fade out, and since when
    this.calm = window.matchMedia?.("(prefers-reduced-motion: reduce)").matches;
    this.picked = null; // what the last click showed
    this.ended = null; // what was streamed before, to know whether the view stays
    canvas.addEventListener("webglcontextlost", () => this.onContext(true));
    canvas.addEventListener("webglcontextrestored", () => this.onContext(false));
    requestAnimationFrame((now) => this.frame(now));
  }

  /** Stream a scene; `wishes` is the body of POST /v1/sessions, `asked` its answer where it was sent already. */
  start(wishes, key, asked = null) {
    this.wishes = wishes;
    this.acks = [];
    if (this.ended?.scene !== wishes.scene) {
      this.forget();
      this.walker.camera = null;
      this.ev = null;
    }
    this.stream.start(wishes, key, asked);
  }

  /** Nothing of what was received is of any use. */
  forget() {
    this.fade = null;
    this.drawn = [];
    this.holes = this.stretched = null;
    this.views++;
    this.keyframes.clear();
  }

  /** Ask for other pictures; `settings` is all that SETTINGS holds, `what` names the change. */
  wish(settings, what) {
    this.settings = settings;
    const { budget_ms, max_error, layers } = settings;
    if (this.wishes) Object.assign(this.wishes, { budget_ms, max_error, layers });
    this.keyframes.outdate();
    this.health.expect(++this.seq, what);
    this.stream.send(TYPE.SETTINGS, { ...settings, seq: this.seq });
  }

  /** Ask what a place of the canvas shows, CSS pixels from its upper left corner. */
  pick(left, top) {
    const camera = this.walker.camera;
    if (!camera) return;
    const x = (left * camera.width) / this.canvas.clientWidth; // in this order: whole pixels stay whole
    const y = (top * camera.height) / this.canvas.clientHeight;
    if (x < 0 || y < 0 || x >= camera.width || y >= camera.height) return;
    this.stream.send(TYPE.PICK, { seq: ++this.picks, camera, x, y });
  }

  onTold(type, header) {
    if (type === TYPE.STATUS) this.health.hear(header);
    else if (type === TYPE.PICKED && header.seq === this.picks) this.hooks.picked(header);
    else if (type === TYPE.LOOK && this.walker.camera) {
      if (header.camera.near !== this.walker.camera.near) this.keyframes.cut = header.camera.near;
      this.walker.jumpTo(header.camera);
      this.dirty = true;
      this.hooks.moved();
    }
  }

  onState(name, detail) {
    this.state = name;
    this.hooks.state(name, detail);
  }

  onWelcome(header, session) {
    const { camera } = header;
    this.diagonal = header.scene.diagonal ?? session.scene_diagonal;
    const again = this.ended?.scene === this.wishes.scene && this.walker.camera;
    if (!again) {
      this.forget();
      this.walker.place(camera, session.up, this.diagonal, { bounds: header.scene.bounds, mode: header.scene.controls });
    } else {
      const { world_from_camera, near } = this.walker.camera;
      this.walker.home = camera;
      this.walker.camera = { ...camera, world_from_camera, near };
    }
    this.keyframes.home = this.walker.home;
    this.ended = { scene: this.wishes.scene };
    this.hooks.scene(header.scene, !again);
    this.acks = [];
    this.pose.camera = null; // the server knows no pose yet
    if (this.settings) this.stream.send(TYPE.SETTINGS, { ...this.settings, seq: ++this.seq }); // a new session knows none of it
    this.sendPose();
    this.warp?.resize(camera.width, camera.height);
    this.dirty = true;
  }

  async onKeyframe(buffer) {
    const socket = this.stream.socket;
    this.traffic.add(buffer.byteLength);
    let image;
    try {
      const coming = this.decoder.decode(buffer, MAX_PIXELS);
      if (!this.warp) this.makeWarp();
      image = await coming;
    } catch (error) {
      this.counts.errors++;
      console.warn(`keyframe refused: ${error.message}`);
      if (socket !== this.stream.socket) return;
      this.counts.resyncs++;
      this.stream.send(TYPE.RESYNC, { last: this.keyframes.newest?.id ?? null });
      return;
    }
    if (socket !== this.stream.socket || !this.warp) return image.color.close(); // of a connection that has ended
    this.counts.images++;
    this.figures.decode.add(image.times.all);
    const earlier = this.keyframes.newest?.header;
    const group = this.keyframes.add(image);
    this.fadeOut(earlier, group?.header);
    if (group) {
      group.bytes = image.bytes;
      group.decode_ms = image.times.all;
      this.acks.push(group);
      this.counts.keyframes++;
      this.health.arrived(image.header);
      this.hooks.keyframe(image.header);
    }
    this.dirty = true;
  }

  /** Only now: until the first pose is sent nobody waits for the graphics, and then the server needs the processor. */
  makeWarp() {
    try {
      this.warp = this.keyframes.warp = new Warp(this.canvas);
    } catch (error) {
      this.stream.stop();
      this.hooks.unable(error);
      return;
    }
    const { width, height } = this.walker.camera;
    this.warp.resize(width, height);
    this.warp.prepare();
  }

  onContext(lost) {
    this.lost = lost;
    this.dirty = true;
    this.hooks.context(lost);
  }

  frame(now) {
    requestAnimationFrame((next) => this.frame(next));
    const passed = Math.min(100, now - (this.before ?? now));
    this.before = now;
    if (passed > 0) {
      this.figures.frame.add(passed);
      this.hooks.frame(passed);
    }
    this.counts.frames++;
    this.moving = this.walker.step(passed / 1000);
    if (this.moving) this.hooks.moved();
    const easing = this.easeExposure(passed / 1000);
    const drawn = (this.moving || this.dirty || easing || this.fade) && !this.lost;
    if (drawn) this.draw();
    else if (!this.lost) this.warp?.uploadNext();
    if (!drawn || this.moving) this.measureHoles(now); // what is new is shown first
    this.sendPose();
    if (now - this.figuresAt < FIGURES_INTERVAL) return;
    this.figuresAt = now;
    this.hooks.figures(this.stats);
  }

  /** Go on to the exposure that is asked for; tells whether the picture changes. */
  easeExposure(seconds) {
    const newest = this.keyframes.newest?.header;
    if (!newest) return false;
    const wished = this.hooks.exposure();
    const target = wished ?? newest.exposure ?? 0;
    const before = this.ev;
    const near = before === null || wished !== null || Math.abs(target - before) < SAME_EV;
    this.ev = near ? target : before + (target - before) * (1 - Math.exp(-seconds / EXPOSURE_EASE));
    return this.ev !== before;
  }

  draw() {
    const view = this.walker.camera;
    if (!view || !this.keyframes.newest) return;
    const begin = performance.now();
    const sources = { ...this.hooks.sources(), most: this.slow ? 1 : undefined };
    const options = { ...sources, exposure: this.ev };
    const share = this.fade ? (begin - this.fade.since) / FADE : 1;
    if (share >= 1) this.fade = null;
    let before = null;
    if (this.fade) {
      this.warp.warp(this.fade.pictures, view, this.near, options);
      before = this.warp.putAside();
    }
    this.drawn = this.keyframes.pictures(view, sources);
    this.warp.warp(this.drawn, view, this.near, options);
    this.warp.present({ fill: sources.fill, before, fade: share });
    this.keyframes.sweep(this.fade?.pictures);
    this.figures.warp.add(performance.now() - begin);
    this.dirty = false;
    this.counts.drawn++;
    this.acknowledge();
  }

  /** The view moves, and drawing cannot keep up: as with no graphics card. */
  get slow() {
    return this.moving && this.figures.frame.value > SLOW;
  }

  /** A new keyframe takes the place of the one before gently, unless it shows another state of the scene. */
  fadeOut(earlier, header) {
    if (!earlier || !header || this.calm || this.slow || !this.drawn.length) return;
    const same = (name) => (earlier[name] ?? 0) === (header[name] ?? 0);
    if (!same("scene_s") || !same("revision")) return;
    this.fade = { pictures: this.drawn, since: performance.now() };
  }

  /** Measure the hole share of the newest picture now and then, and once more when nothing moves. */
  measureHoles(now) {
    if (this.lost || !this.drawn.length || this.holesOf === this.counts.drawn || now - this.holesAt < HOLES_INTERVAL) return;
    this.holesAt = now;
    const { views, counts: { drawn } } = this;
    const take = (shares) => {
      if (!shares || views !== this.views) return; // an earlier reading is under way: this one comes later
      Object.assign(this, shares);
      this.holesOf = drawn;
    };
    this.warp.holeShare().then(take, () => {}); // fails with the context
  }

  get near() {
    const nearest = this.keyframes.newest?.header.depth.near ?? Infinity;
    return Math.min(CLIP_SHARE * this.diagonal, Math.max(this.walker.camera.near, CLIP_SAMPLE * nearest));
  }

  acknowledge() {
    const shown = performance.now();
    for (const group of this.acks.splice(0)) {
      const { header } = group;
      if (header.pose >= 0 && !header.still) this.figures.latency.add(shown - header.time_ms);
      const holes = Math.min(1, Math.max(0, this.holes ?? 0));
      this.stream.send(TYPE.ACK, { id: group.id, decode_ms: group.decode_ms, shown_ms: shown, holes });
    }
  }

  /** Tell the newest pose, at most every POSE_INTERVAL, and once more when the movement ends. */
  sendPose() {
    const now = performance.now();
    const moved = this.moving;
    const camera = this.walker.camera;
    if (this.state !== "live" || !camera || now - this.pose.sent < POSE_INTERVAL) return;
    if (identical(camera, this.pose.camera) && this.pose.moving === moved) return;
    const { spin } = this.walker;
    const velocity = this.walker.foreseen(Math.max(FORESEEN, (this.figures.latency.value ?? 0) / 1000));
    const header = { seq: ++this.pose.seq, time_ms: now, camera, velocity, spin, moving: moved };
    if (!moved) Object.assign(header, { velocity: [0, 0, 0], spin: [0, 0, 0] });
    if (this.stream.send(TYPE.POSE, header, { droppable: true })) this.pose = { ...this.pose, sent: now, camera, moving: moved };
  }

  get stats() {
    const { frame, warp, decode, latency } = this.figures;
    const view = this.walker.camera;
    const drawn = view ? this.keyframes.pictures(view, this.hooks.sources()) : [];
    return {
      ...this.counts,
      connections: this.stream.connections,
      frame_ms: frame.value,
      warp_ms: warp.value,
      decode_ms: decode.value,
      latency_ms: latency.value,
      holes: this.holes,
      stretched: this.stretched,
      exposure: this.ev,
      shown: this.drawn.length > 0, // a picture of this scene
      age_ms: this.health.age,
      notice: this.health.notice,
      bytes_per_second: this.traffic.perSecond(),
      keyframe_bytes: this.keyframes.newest?.bytes ?? 0,
      pictures: drawn.length,
      quads: drawn.reduce((sum, picture) => sum + picture.quads, 0),
    };
  }

  // ------------------------------------------------------------------ for window.torchrender

  /** Draw another view (default: the present one) beside the loop and read it; the page shows the present one again. */
  capture({ camera = this.walker.camera, earlier = true, layers = true, fill = true, ...options } = {}) {
    const pictures = this.keyframes.pictures(camera, { earlier, layers });
    this.warp.warp(pictures, camera, this.near, { ...options, exposure: this.ev });
    const pixels = this.warp.capture(fill);
    this.dirty = true;
    const { width, height } = this.warp.target;
    return { width, height, pixels };
  }

  /** Milliseconds for one frame of the warp, drawn and waited for, over `count` frames. */
  measure(count = 20, sources = {}) {
    const pictures = this.keyframes.pictures(this.walker.camera, sources);
    const begin = performance.now();
    for (let k = 0; k < count; k++) {
      this.warp.warp(pictures, this.walker.camera, this.near, { ...sources, direct: false });
      this.warp.present();
      this.warp.finish();
    }
    this.dirty = true;
    return (performance.now() - begin) / count;
  }
}
