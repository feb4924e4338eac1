/** The newest trace, in arrays that are made once for a layout (signals and number of buckets). Pure. */

/** @typedef {{view: number, signals: string[], live: boolean, t0_s: number, dt_s: number, buckets: number, lost: number}} TraceHeader */

export class Buckets {
  constructor() {
    this.count = 0;
    this.t0_s = 0;
    this.dt_s = 1;
    this.live = true;
    this.lost = 0;
    /** @type {string[]} */
    this.signals = [];
    /** Middle of each bucket, s. */
    this.time_s = new Float64Array(0);
    /** @type {Float32Array} `[signal][min, max][bucket]` */
    this._values = new Float32Array(0);
    /** @type {Float32Array[]} of a signal the minimum, then the maximum */
    this._rows = [];
  }

  /**
   * Copy a trace in.
   * @param {TraceHeader} header
   * @param {Float32Array} floats
   * @returns {boolean} whether the layout is another one, and `row` and `time_s` are new arrays
   */
  take(header, floats) {
    const size = header.signals.length * 2 * header.buckets;
    if (floats.length !== size) throw new Error(`trace: ${floats.length} floats instead of ${size}`);
    const changed = this._layout(header);
    this._values.set(floats);
    if (changed || header.t0_s !== this.t0_s || header.dt_s !== this.dt_s) {
      for (let i = 0; i < this.count; i++) this.time_s[i] = header.t0_s + (i + 0.5) * header.dt_s;
    }
    this.t0_s = header.t0_s;
    this.dt_s = header.dt_s;
    this.live = header.live;
    this.lost = header.lost;
    return changed;
  }

  /** @param {TraceHeader} header */
  _layout(header) {
    const { signals, buckets } = header;
    const same = signals.length === this.signals.length && buckets === this.count;
    if (same && signals.every((name, i) => name === this.signals[i])) return false;
    this.signals = [...signals];
    this.count = buckets;
    this.time_s = new Float64Array(buckets);
    this._values = new Float32Array(signals.length * 2 * buckets);
    this._rows = [];
    for (let row = 0; row < signals.length * 2; row++) {
      this._rows.push(this._values.subarray(row * buckets, (row + 1) * buckets));
    }
    return true;
  }

  get end_s() {
    return this.t0_s + this.count * this.dt_s;
  }

  /** @param {string} name @returns {[Float32Array, Float32Array] | null} minimum and maximum */
  row(name) {
    const i = this.signals.indexOf(name);
    return i < 0 ? null : [this._rows[2 * i], this._rows[2 * i + 1]];
  }

  /** The bucket that has time `t_s`, or -1. @param {number} t_s */
  at(t_s) {
    const i = Math.floor((t_s - this.t0_s) / this.dt_s);
    return i >= 0 && i < this.count ? i : -1;
  }

  /** The newest bucket of a signal that has ticks, or -1. @param {string} name */
  newest(name) {
    const row = this.row(name);
    if (row === null) return -1;
    let i = this.count - 1;
    while (i >= 0 && Number.isNaN(row[0][i])) i--;
    return i;
  }

  /**
   * Extend [low, high] by all of a signal. @param {string} name @param {Float64Array} range
   */
  extend(name, range) {
    const row = this.row(name);
    if (row === null) return;
    const [low, high] = row;
    for (let i = 0; i < low.length; i++) {
      if (low[i] < range[0]) range[0] = low[i];
      if (high[i] > range[1]) range[1] = high[i];
    }
  }
}
