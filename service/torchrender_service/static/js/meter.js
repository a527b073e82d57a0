// Figures of the last seconds.

const WINDOW = 3000; // ms

/** Sums over a sliding window. */
export class Rate {
  constructor() {
    this.events = [];
  }

  add(amount, now = performance.now()) {
    this.events.push([now, amount]);
  }

  perSecond(now = performance.now()) {
    while (this.events.length && this.events[0][0] < now - WINDOW) this.events.shift();
    return this.events.reduce((sum, [, amount]) => sum + amount, 0) / (WINDOW / 1000);
  }
}

const RECENT = 9;

/** Median of the last values: one that was very slow, such as the first, does not show for long. */
export class Median {
  constructor() {
    this.recent = [];
  }

  add(value) {
    this.recent.push(value);
    if (this.recent.length > RECENT) this.recent.shift();
  }

  get value() {
    const sorted = [...this.recent].sort((a, b) => a - b);
    return sorted.length ? sorted[(sorted.length - 1) >> 1] : null;
  }
}

/** Mean that forgets: each new value weighs a tenth. */
export class Smooth {
  constructor() {
    this.value = null;
  }

  add(value) {
    this.value = this.value === null ? value : this.value + 0.1 * (value - this.value);
  }
}
