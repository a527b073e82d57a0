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

/** Mean that forgets: each new value weighs a tenth. */
export class Smooth {
  constructor() {
    this.value = null;
  }

  add(value) {
    this.value = this.value === null ? value : this.value + 0.1 * (value - this.value);
  }
}
