// Walking and looking with mouse, keyboard and touch.

import { add, axesOf, cross, dot, eyeOf, length, normalize, placed, rotate, scale } from "./camera.js";

const WALK = 0.14; // of the scene's diagonal per second
const TURN = 1.1; // radians per second with the arrow keys
const EASE = 0.09; // seconds until a step has (nearly) its speed
const STEEPEST = 1.5; // radians between the horizon and the view
const WHEEL = 0.0009; // of the diagonal per pixel of the wheel
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

export class Walker {
  /** `stage` gets pointer and key events; `stick` is the on-screen stick with its knob as first child. */
  constructor(stage, stick) {
    this.stage = stage;
    this.stick = stick;
    this.held = new Set();
    this.pointers = new Map();
    this.push = [0, 0];
    this.turn = [0, 0]; // radians to turn in the next step: right, up
    this.jump = [0, 0, 0]; // scene units to move in the next step: right, up, forward
    this.speed = 1;
    this.velocity = [0, 0, 0];
    this.spin = [0, 0, 0];
    this.camera = null;
    this.listen();
  }

  /** Stand where `camera` is. */
  place(camera, up, diagonal) {
    this.home = camera;
    this.up = normalize(up);
    this.diagonal = diagonal;
    this.reset();
  }

  reset() {
    this.camera = this.home;
    this.velocity = [0, 0, 0];
    this.turn = [0, 0];
    this.jump = [0, 0, 0];
  }

  listen() {
    const { stage, stick } = this;
    window.addEventListener("keydown", (event) => {
      // Keys belong to the scene unless something else has the focus.
      const elsewhere = ![stage, document.body].includes(document.activeElement);
      if (elsewhere || event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.code === "Home" || event.code === "KeyR") this.reset();
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
    });
    stage.addEventListener("pointermove", (event) => this.drag(event));
    for (const name of ["pointerup", "pointercancel"])
      stage.addEventListener(name, (event) => this.pointers.delete(event.pointerId));
    stage.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.jump[2] -= event.deltaY * WHEEL * (this.diagonal ?? 0);
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
    if (this.pointers.size === 1) {
      this.turn[0] -= (now[0] - before[0]) * angle;
      this.turn[1] += (now[1] - before[1]) * angle;
    } else if (this.pointers.size === 2) {
      const [other] = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
      this.jump[2] += 0.0015 * this.diagonal * (apart(now) - apart(before));
      this.jump[1] += 0.0004 * this.diagonal * (now[1] - before[1]);
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

  wish(name) {
    let sum = 0;
    for (const code of this.held) if (KEYS[code][0] === name) sum += KEYS[code][1];
    return Math.max(-1, Math.min(1, sum));
  }

  /** Move on by `seconds`; tells whether the view changed. */
  step(seconds) {
    if (!this.camera || seconds <= 0) return false;
    const yaw = this.turn[0] + this.wish("yaw") * TURN * seconds;
    const pitch = this.turn[1] + this.wish("pitch") * TURN * seconds;
    this.turn = [0, 0];
    const turned = this.look(yaw, pitch);
    this.spin = scale(turned.spin, 1 / seconds);
    const moved = this.walk(seconds);
    return yaw !== 0 || turned.pitch !== 0 || moved;
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
    this.velocity = this.velocity.map((v, k) => v + (pace * wish[k] - v) * ease);
    if (length(wish) === 0 && length(this.velocity) < 0.01 * pace) this.velocity = [0, 0, 0];
    const jump = move(...this.jump);
    this.jump = [0, 0, 0];
    const step = add(scale(this.velocity, seconds), jump);
    if (length(step) === 0) return false;
    this.camera = placed(this.camera, add(eyeOf(this.camera), step), axesOf(this.camera));
    return true;
  }
}
