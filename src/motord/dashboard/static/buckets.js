/** What a view shows, in arrays that are made once for a layout (signals and number of buckets). Pure. */

/** @typedef {{view: number, signals: string[], live: boolean, whole: boolean, t0_s: number, dt_s: number, buckets: number, newest_s: number, lost: number}} TraceHeader */

export class Buckets {
  constructor() {
    this.count = 0;
    this.dt_s = 1;
    /** Number of the first bucket: it begins at `first * dt_s`. */
    this.first = 0;
    /** @type {string[]} */
    this.signals = [];
    /** Another one when what was taken is not what went on from before. */
    this.version = 0;
    /** @type {Float32Array[]} of each signal the minima, then the maxima */
    this._rows = [];
  }

  /**
   * Take a trace: all of a view, or what is new of a live one.
   * @param {TraceHeader} header
   * @param {Float32Array} floats `[signal][min, max][bucket]`
   * @returns {boolean} whether the layout is another one: rows are new arrays
   */
  take(header, floats) {
    const size = header.signals.length * 2 * header.buckets;
    if (floats.length !== size) throw new Error(`trace: ${floats.length} floats instead of ${size}`);
    const number = Math.round(header.t0_s / header.dt_s);
    const changed = header.whole && this._layout(header);
    if (header.whole) {
      this.first = number;
      this.dt_s = header.dt_s;
      this.version++;
    } else if (header.dt_s !== this.dt_s || header.signals.length !== this.signals.length) return false;
    this._makeRoom(number, number + header.buckets);
    for (let row = 0; row < this._rows.length; row++) this._write(row, number, header.buckets, floats);
    return changed;
  }

  /** @param {TraceHeader} header */
  _layout(header) {
    const { signals, buckets } = header;
    const same = signals.length === this.signals.length && buckets === this.count;
    if (same && signals.every((name, i) => name === this.signals[i])) return false;
    this.signals = [...signals];
    this.count = buckets;
    this._rows = Array.from({ length: signals.length * 2 }, () => new Float32Array(buckets));
    return true;
  }

  /** Move on so that bucket `end - 1` is the last; what is skipped between has no ticks. @param {number} begin @param {number} end */
  _makeRoom(begin, end) {
    const before = this.first + this.count;
    const shift = end - before;
    if (shift <= 0) return;
    this.first += shift;
    for (const row of this._rows) {
      row.copyWithin(0, shift);
      row.fill(NaN, Math.max(0, this.count - shift), Math.max(0, Math.min(this.count, begin - this.first)));
    }
  }

  /** @param {number} row @param {number} number of the first bucket that came @param {number} buckets @param {Float32Array} floats */
  _write(row, number, buckets, floats) {
    const to = this._rows[row];
    for (let i = Math.max(0, this.first - number); i < buckets; i++) to[number - this.first + i] = floats[row * buckets + i];
  }

  get t0_s() {
    return this.first * this.dt_s;
  }

  get end_s() {
    return (this.first + this.count) * this.dt_s;
  }

  /** @param {string} name @returns {[Float32Array, Float32Array] | null} minimum and maximum */
  row(name) {
    const i = this.signals.indexOf(name);
    return i < 0 ? null : [this._rows[2 * i], this._rows[2 * i + 1]];
  }

  /** The bucket that has time `t_s`, or -1. @param {number} t_s */
  at(t_s) {
    const i = Math.floor(t_s / this.dt_s) - this.first;
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
