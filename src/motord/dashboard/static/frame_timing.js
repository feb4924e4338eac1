/** Live frames in the browser's performance timeline: how long samples take to the screen. Pure but for that. */

const NAME = "motord.frame";

export class FrameTiming {
  constructor() {
    /** Times of the newest sample that came, and that is drawn. */
    this._newest_s = this._drawn_s = 0;
  }

  /** A trace came; one that is whole has old samples, too. @param {{whole: boolean, newest_s: number}} header */
  take({ whole, newest_s }) {
    this._newest_s = newest_s;
    if (whole) this._drawn_s = newest_s;
  }

  /** A frame was drawn: measured from the middle of its new samples on. @param {number} epoch_s @param {number} now_ms Unix */
  drawn(epoch_s, now_ms) {
    if (this._newest_s <= this._drawn_s) return;
    const sampled_s = epoch_s + (this._drawn_s + this._newest_s) / 2;
    this._drawn_s = this._newest_s;
    const end = performance.now();
    const start = Math.max(0, end - (now_ms - 1000 * sampled_s));
    performance.measure(NAME, { start, end, detail: { sampled_s } });
    performance.clearMeasures(NAME); // observers have it; the page is open for days
  }
}
