// A gamepad as wishes to move: left stick walks, right stick looks, triggers go down and up.

const DEAD = 0.15; // of a stick's way: it never rests quite in the middle

const bent = (value) => (Math.abs(value) < DEAD ? 0 : Math.sign(value) * ((Math.abs(value) - DEAD) / (1 - DEAD)) ** 2);

/** Wishes by name, each in [-1, 1], of the first gamepad; none without one. */
export function readGamepad() {
  const pad = [...(navigator.getGamepads?.() ?? [])].find((one) => one?.connected);
  if (!pad) return {};
  const [x, y, u, v] = [0, 1, 2, 3].map((k) => bent(pad.axes[k] ?? 0));
  const trigger = (k) => pad.buttons[k]?.value ?? 0;
  return { right: x, forward: -y, yaw: u, pitch: -v, up: trigger(7) - trigger(6) };
}
