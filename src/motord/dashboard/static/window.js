/** Which piece of time is shown: live, or held and moved. Pure; all times in s since the epoch of `hello`. */

export const SPANS_S = [1, 2, 5, 10, 20, 30, 60, 120, 300, 600];
const SHORTEST_S = 0.02;
const LONGEST_S = 600;

export class TimeWindow {
  /** @param {number} span_s @param {number} history_s how far back the server can go */
  constructor(span_s = 10, history_s = LONGEST_S) {
    this.span_s = span_s;
    this.history_s = history_s;
    /** @type {number | null} null: live, ends now */
    this.end_s = null;
  }

  get live() {
    return this.end_s === null;
  }

  /** Hold what is shown, which ends at `now_s`. @param {number} now_s */
  pause(now_s) {
    if (this.end_s === null) this.end_s = now_s;
  }

  resume() {
    this.end_s = null;
    this.span_s = SPANS_S.find((span) => span >= this.span_s * 0.999) ?? LONGEST_S;
  }

  /** Show `span_s`, live or about the middle. @param {number} span_s */
  setSpan(span_s) {
    const span = Math.min(Math.max(span_s, SHORTEST_S), LONGEST_S);
    if (this.end_s !== null) this.end_s += (span - this.span_s) / 2;
    this.span_s = span;
  }

  /** One step of zoom: live through the spans, held by half or double about `about_s`.
   * @param {number} direction -1 closer, 1 further @param {number | null} about_s */
  zoom(direction, about_s = null) {
    if (this.end_s === null) {
      const i = SPANS_S.findIndex((span) => span >= this.span_s * 0.999);
      const next = Math.min(Math.max((i < 0 ? SPANS_S.length - 1 : i) + direction, 0), SPANS_S.length - 1);
      this.span_s = SPANS_S[next];
      return;
    }
    const span = Math.min(Math.max(this.span_s * (direction < 0 ? 0.5 : 2), SHORTEST_S), LONGEST_S);
    const about = about_s ?? this.end_s - this.span_s / 2;
    this.end_s = about + ((this.end_s - about) * span) / this.span_s;
    this.span_s = span;
  }

  /** Show from `from_s` to `to_s`, held. @param {number} from_s @param {number} to_s */
  select(from_s, to_s) {
    this.span_s = Math.max(to_s - from_s, SHORTEST_S);
    this.end_s = to_s;
  }

  /** Move by a fraction of the span, held. @param {number} fraction @param {number} now_s */
  pan(fraction, now_s) {
    this.pause(now_s);
    const end = /** @type {number} */ (this.end_s) + fraction * this.span_s;
    this.end_s = Math.max(Math.min(end, now_s), now_s - this.history_s + this.span_s);
  }
}
