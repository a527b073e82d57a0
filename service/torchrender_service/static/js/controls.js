// Moving about with mouse, keyboard, touch and gamepad: walking through a room, or orbiting an object.

import { add, axesOf, cross, dot, eyeOf, length, normalize, placed, rotate, scale, subtract } from "./camera.js";
import { readGamepad } from "./gamepad.js";

const WALK = 0.14; // of the scene's diagonal per second
const TURN = 1.1; // radians per second with the arrow keys
const EASE = 0.09; // seconds until a step has (nearly) its speed
const STEEPEST = 1.5; // radians between the horizon and the view
const WHEEL = 0.0006; // of the diagonal per pixel of the wheel
const ZOOM = 0.0015; // of the distance, as a logarithm, per pixel of the wheel
const COAST = 0.11; // seconds in which most of a turn of the wheel is gone
const MOST_COAST = 0.2; // of the diagonal that may be left to go
const SLOWEST = 0.0005; // of the diagonal per second: what is slower stands still
const DOLLY = 1.2; // of the distance, as a logarithm, per second
const PAN = 0.7; // of the distance per second
const NEAREST = 0.002; // of the diagonal
const CLIP = 0.002; // of the diagonal: what is nearer than this is cut off,
const ORBIT_CLIP = 0.1; // or, in orbit, this share of the distance
const FARTHEST = 4;
const MARGIN = 0.35; // of the diagonal around scene and start: nobody gets lost farther out
const STICK = 44; // CSS pixels from the stick's centre to full speed

// Directions: right, up, forward, and turning right and up.
const KEYS = {
  KeyW: ["forward", 1],
  KeyS: ["forward", -1],
  KeyA: ["right", -1],
  KeyD: ["right", 1],
  Space: ["up", 1],
  ShiftLeft: ["up", -1],
  ShiftRight: ["up", -1],
  ArrowLeft: ["yaw", -1],
  ArrowRight: ["yaw", 1],
  ArrowUp: ["pitch", 1],
  ArrowDown: ["pitch", -1],
};

/** Axes (right, down, forward) of a view along `way` without roll. */
export function axesTowards(way, up) {
  const forward = normalize(way);
  const flat = cross(forward, up);
  const right = length(flat) > 1e-6 ? normalize(flat) : normalize(cross(forward, [up[1], up[2], up[0]]));
  return [right, cross(forward, right), forward];
}

export class Walker {
  /** `stage` gets pointer and key events; `stick` is the on-screen stick with its knob as first child. */
  constructor(stage, stick) {
    this.stage = stage;
    this.stick = stick;
    this.held = new Set();
    this.pointers = new Map();
    this.pad = {}; // wishes of a gamepad
    this.panning = false; // a drag moves to the side
    this.push = [0, 0];
    this.turn = [0, 0]; // radians to turn in the next step: right, up
    this.jump = [0, 0, 0]; // scene units to move in the next step: right, up, forward
    this.coast = 0; // what is left to go of turns of the wheel: scene units, or in orbit logarithm of the distance
    this.speed = 1;
    this.drift = [0, 0, 0]; // the speed of walking, eased
    this.velocity = [0, 0, 0];
    this.mode = "walk";
    this.pivot = [0, 0, 0]; // what is orbited
    this.obstacles = null;
    this.spin = [0, 0, 0];
    this.camera = null;
    this.listen();
  }

  /** Stand where `camera` is. */
  place(camera, up, diagonal, { bounds, mode = "walk" }) {
    this.home = camera;
    this.up = normalize(up);
    this.diagonal = diagonal;
    this.bounds = bounds;
    this.mode = mode;
    this.obstacles = null; // of another scene
    this.reset();
  }

  /** Back to the start. */
  reset() {
    this.jumpTo(this.home);
  }

  /** Stand still where another camera is, with its near plane; opening angle and size stay. */
  jumpTo(camera) {
    const { world_from_camera, near } = camera;
    this.camera = { ...(this.camera ?? camera), world_from_camera, near };
    if (camera === this.home) this.camera = camera;
    this.velocity = [0, 0, 0];
    this.drift = [0, 0, 0];
    this.turn = [0, 0];
    this.jump = [0, 0, 0];
    this.coast = 0;
    this.findPivot();
    this.given = near; // holds where it was given; from there on the near plane follows the view, never farther away
    if (!camera.target) return;
    this.pivot = camera.target;
    this.bringNear(); // a place in words has no near plane of its own
  }

  /** A near plane that lets through whatever a view may come close to from here. */
  bringNear() {
    const orbit = this.orbiting ? ORBIT_CLIP * this.distance : Infinity;
    this.camera = { ...this.camera, near: Math.min(this.given, CLIP * this.diagonal, orbit) };
  }

  /** Walk or orbit from where the view is. */
  setMode(mode) {
    if (mode === this.mode) return;
    this.mode = mode;
    this.coast = 0;
    this.drift = [0, 0, 0];
    if (this.camera) this.findPivot();
  }

  /** Orbit the point straight ahead that is as far away as the middle of the scene: so nothing turns by itself. */
  findPivot() {
    const middle = scale(add(...this.bounds), 0.5);
    const eye = eyeOf(this.camera);
    const ahead = normalize(axesOf(this.camera)[2]);
    const far = Math.max(0.05 * this.diagonal, dot(subtract(middle, eye), ahead));
    this.pivot = add(eye, scale(ahead, far));
  }

  /** Turn to a point and orbit it from now on. */
  orbitAbout(point) {
    const eye = eyeOf(this.camera);
    this.camera = placed(this.camera, eye, axesTowards(subtract(point, eye), this.up));
    this.pivot = point;
    this.bringNear();
  }

  listen() {
    const { stage, stick } = this;
    window.addEventListener("keydown", (event) => {
      // Keys belong to the scene unless something else has the focus.
      const elsewhere = ![stage, document.body].includes(document.activeElement);
      if (elsewhere || event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.code === "Home" || event.code === "KeyR") this.camera && this.reset();
      else if (KEYS[event.code]) this.held.add(event.code);
      else return;
      event.preventDefault();
    });
    window.addEventListener("keyup", (event) => this.held.delete(event.code));
    const release = () => {
      this.held.clear();
      this.pointers.clear();
      this.setStick(0, 0);
    };
    window.addEventListener("blur", release);
    document.addEventListener("focusin", () => this.held.clear());
    stage.addEventListener("pointerdown", (event) => {
      event.preventDefault(); // a click needs no focus ring
      document.activeElement?.blur();
      stage.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
      this.panning = event.button > 0 || event.shiftKey;
    });
    stage.addEventListener("contextmenu", (event) => event.preventDefault()); // that button pans
    stage.addEventListener("pointermove", (event) => this.drag(event));
    for (const name of ["pointerup", "pointercancel"])
      stage.addEventListener(name, (event) => this.pointers.delete(event.pointerId));
    stage.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        const lines = event.deltaMode === 1 ? 32 : 1; // Firefox counts lines
        const most = this.orbiting ? 1.5 : MOST_COAST * (this.diagonal ?? 0);
        const unit = this.orbiting ? ZOOM : WHEEL * (this.diagonal ?? 0);
        this.coast = Math.max(-most, Math.min(most, this.coast - lines * event.deltaY * unit));
      },
      { passive: false },
    );
    stick.addEventListener("pointerdown", (event) => {
      stick.setPointerCapture(event.pointerId);
      this.moveStick(event);
    });
    stick.addEventListener("pointermove", (event) => stick.hasPointerCapture(event.pointerId) && this.moveStick(event));
    for (const name of ["pointerup", "pointercancel"]) stick.addEventListener(name, () => this.setStick(0, 0));
  }

  /** One pointer turns the view as if it held the scene; two move up, down and (pinching) forwards. */
  drag(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before || !this.camera) return;
    const now = [event.clientX, event.clientY];
    const angle = this.camera.height / this.camera.fy / this.stage.clientHeight; // radians per CSS pixel
    const pixel = angle * (this.orbiting ? this.distance : 0.3 * this.diagonal); // scene units per CSS pixel
    if (this.pointers.size === 1 && this.panning) {
      this.jump[0] -= pixel * (now[0] - before[0]);
      this.jump[1] += pixel * (now[1] - before[1]);
    } else if (this.pointers.size === 1 && this.orbiting) {
      const turn = Math.PI / this.stage.clientHeight;
      this.turn[0] += (now[0] - before[0]) * turn;
      this.turn[1] -= (now[1] - before[1]) * turn;
    } else if (this.pointers.size === 1) {
      this.turn[0] -= (now[0] - before[0]) * angle;
      this.turn[1] += (now[1] - before[1]) * angle;
    } else if (this.pointers.size === 2) {
      const [other] = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
      if (this.orbiting) {
        this.coast += Math.log(apart(now) / Math.max(1, apart(before)));
        this.jump[0] -= 0.5 * pixel * (now[0] - before[0]);
        this.jump[1] += 0.5 * pixel * (now[1] - before[1]);
      } else {
        this.jump[2] += 0.0015 * this.diagonal * (apart(now) - apart(before));
        this.jump[1] += 0.0004 * this.diagonal * (now[1] - before[1]);
      }
    }
    this.pointers.set(event.pointerId, now);
  }

  moveStick(event) {
    const box = this.stick.getBoundingClientRect();
    const x = (event.clientX - box.left - box.width / 2) / STICK;
    const y = (event.clientY - box.top - box.height / 2) / STICK;
    const far = Math.max(1, Math.hypot(x, y));
    this.setStick(x / far, y / far);
  }

  setStick(x, y) {
    this.push = [x, -y];
    const knob = this.stick.firstElementChild;
    if (knob) knob.style.transform = `translate(${x * STICK * 0.6}px, ${y * STICK * 0.6}px)`;
  }

  get orbiting() {
    return this.mode === "orbit";
  }

  /** From the eye to what is orbited. */
  get distance() {
    return length(subtract(this.pivot, eyeOf(this.camera)));
  }

  wish(name) {
    let sum = this.pad[name] ?? 0;
    for (const code of this.held) if (KEYS[code][0] === name) sum += KEYS[code][1];
    return Math.max(-1, Math.min(1, sum));
  }

  /** Move on by `seconds`; tells whether the view changed. */
  step(seconds) {
    if (!this.camera || seconds <= 0) return false;
    this.pad = readGamepad();
    const from = eyeOf(this.camera);
    const yaw = this.turn[0] + this.wish("yaw") * TURN * seconds;
    const pitch = this.turn[1] + this.wish("pitch") * TURN * seconds;
    this.turn = [0, 0];
    const turned = this.look(yaw, pitch);
    this.spin = scale(turned.spin, 1 / seconds);
    const moved = this.orbiting ? this.circle(seconds, yaw !== 0 || turned.pitch !== 0) : this.walk(seconds);
    this.velocity = scale(subtract(eyeOf(this.camera), from), 1 / seconds);
    const changed = yaw !== 0 || turned.pitch !== 0 || moved;
    if (changed) this.bringNear();
    return changed;
  }

  /**
   * Scene units per second that lead, in so many seconds, to where the view will be: a turn of the wheel ends, and walls
   * are in the way, which the server does not know.
   */
  foreseen(seconds) {
    if (this.coast === 0 && !this.obstacles) return this.velocity;
    if (this.orbiting) return scale(this.velocity, this.coast === 0 ? 1 : Math.min(1, COAST / seconds));
    const ahead = normalize(axesOf(this.camera)[2]);
    const path = add(scale(this.drift, seconds), scale(ahead, this.coast * (1 - Math.exp(-seconds / COAST))));
    const eye = eyeOf(this.camera);
    const end = this.within(this.obstacles ? this.obstacles.move(eye, path) : add(eye, path));
    return scale(subtract(end, eye), 1 / seconds);
  }

  /** What the wheel still moves in this step. */
  roll(seconds) {
    const part = this.coast * (1 - Math.exp(-seconds / COAST));
    this.coast -= part;
    const unit = this.orbiting ? 1 : this.diagonal;
    if (Math.abs(this.coast) < COAST * SLOWEST * unit) this.coast = 0;
    return part;
  }

  /** Stand behind what is orbited as the axes say, nearer or farther, and to the side. */
  circle(seconds, turned) {
    const axes = axesOf(this.camera);
    const [right, down, forward] = axes.map(normalize);
    const closer = this.roll(seconds) + this.wish("forward") * DOLLY * seconds + this.push[1] * DOLLY * seconds;
    const far = this.distance * Math.exp(-closer);
    const limited = Math.max(NEAREST * this.diagonal, Math.min(FARTHEST * this.diagonal, far));
    const pace = PAN * limited * seconds;
    const aside = [this.jump[0] + pace * (this.wish("right") + this.push[0]), this.jump[1] + pace * this.wish("up")];
    this.jump = [0, 0, 0];
    this.pivot = add(this.pivot, add(scale(right, aside[0]), scale(down, -aside[1])));
    if (!turned && closer === 0 && aside[0] === 0 && aside[1] === 0) return false;
    this.camera = placed(this.camera, subtract(this.pivot, scale(forward, limited)), axes);
    return true;
  }

  /** Turn about the vertical, then about the camera's horizontal axis, not over the top. */
  look(yaw, pitch) {
    let axes = axesOf(this.camera);
    const height = Math.asin(Math.max(-1, Math.min(1, dot(normalize(axes[2]), this.up))));
    const limited = Math.max(Math.min(-STEEPEST, height), Math.min(Math.max(STEEPEST, height), height + pitch)) - height;
    if (yaw === 0 && limited === 0) return { pitch: 0, spin: [0, 0, 0] };
    const down = scale(this.up, -1);
    axes = axes.map((axis) => rotate(axis, down, yaw));
    axes = axes.map((axis) => rotate(axis, normalize(axes[0]), limited));
    const world = add(scale(down, yaw), scale(normalize(axes[0]), limited));
    const right = normalize(axes[0]);
    const forward = normalize(add(axes[2], scale(right, -dot(axes[2], right))));
    this.camera = placed(this.camera, eyeOf(this.camera), [right, cross(forward, right), forward]);
    return { pitch: limited, spin: axes.map((axis) => dot(axis, world)) };
  }

  walk(seconds) {
    const [right, , forward] = axesOf(this.camera);
    const level = add(forward, scale(this.up, -dot(forward, this.up)));
    const ahead = length(level) > 1e-6 ? normalize(level) : normalize(forward);
    const move = (r, u, f) => add(add(scale(normalize(right), r), scale(this.up, u)), scale(ahead, f));
    const [x, y] = this.push;
    let wish = move(this.wish("right") + x, this.wish("up"), this.wish("forward") + y);
    if (length(wish) > 1) wish = normalize(wish);
    const pace = WALK * this.diagonal * this.speed;
    const ease = 1 - Math.exp(-seconds / EASE);
    this.drift = this.drift.map((v, k) => v + (pace * wish[k] - v) * ease);
    if (length(wish) === 0 && length(this.drift) < 0.01 * pace) this.drift = [0, 0, 0];
    const jump = add(move(...this.jump), scale(normalize(forward), this.roll(seconds))); // the wheel goes where one looks
    this.jump = [0, 0, 0];
    const step = add(scale(this.drift, seconds), jump);
    if (length(step) === 0) return false;
    const eye = eyeOf(this.camera);
    const free = this.obstacles ? this.obstacles.move(eye, step) : add(eye, step);
    this.camera = placed(this.camera, this.within(free), axesOf(this.camera));
    return true;
  }

  /** The nearest place that is not far outside of the scene. */
  within(eye) {
    const start = eyeOf(this.home);
    const margin = MARGIN * this.diagonal;
    const [low, high] = this.bounds;
    return eye.map((v, k) =>
      Math.min(Math.max(high[k], start[k]) + margin, Math.max(Math.min(low[k], start[k]) - margin, v)),
    );
  }
}
