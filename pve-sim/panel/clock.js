// Virtual time, extrapolated between the instants that the server sends.

/** The time without a message after which the clock stands still, in milliseconds of wall time. */
const LEAD = 2000;
/** The lead over the server beyond which the clock is set back, in milliseconds of wall time. */
const TOLERANCE = 500;

let t = 0;
let heardAt = 0;
let messageAt = 0;
let factor = 0;
let isRunning = false;

export const clock = {
  /** Returns the instant, in microseconds. */
  now() {
    return isRunning ? t + (Math.min(performance.now(), messageAt + LEAD) - heardAt) * 1000 * factor : t;
  },

  /** Adjusts the clock to an instant from the server. */
  hear(t_us) {
    const now = this.now();
    messageAt = performance.now();
    if (t_us >= now || now - t_us > TOLERANCE * 1000 * factor) {
      t = t_us;
      heardAt = messageAt;
    }
  },

  /** Starts the clock at an instant; `speed` is a factor or `"step"`. */
  start(t_us, speed) {
    t = t_us;
    heardAt = messageAt = performance.now();
    factor = speed === "step" ? 0 : speed;
    isRunning = factor > 0;
  },

  /** Stops the clock at the current instant. */
  stop() {
    t = this.now();
    isRunning = false;
  },

  /** Whether virtual time passes without steps. */
  get isRunning() {
    return isRunning;
  },
};
