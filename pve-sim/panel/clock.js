// Virtual time, extrapolated between the instants that the server sends.

/** A clock that is behind by more than this, in milliseconds of wall time, is set back. */
const TOLERANCE = 500;

let t = 0;
let heardAt = 0;
let factor = 0;
let isRunning = false;

export const clock = {
  /** Returns the instant, in microseconds. */
  now() {
    return isRunning ? t + (performance.now() - heardAt) * 1000 * factor : t;
  },

  /** Hears an instant that the server tells. */
  hear(t_us) {
    const now = this.now();
    if (t_us >= now || now - t_us > TOLERANCE * 1000 * factor) {
      t = t_us;
      heardAt = performance.now();
    }
  },

  /** Starts at an instant; `speed` is the server's: a factor, or `"step"`. */
  start(t_us, speed) {
    t = t_us;
    heardAt = performance.now();
    factor = speed === "step" ? 0 : speed;
    isRunning = factor > 0;
  },

  /** Stops the clock while the server is away. */
  stop() {
    t = this.now();
    isRunning = false;
  },

  /** Whether time passes by itself. */
  get isRunning() {
    return isRunning;
  },
};
