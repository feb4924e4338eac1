/** Events and notes as marks in time. */

const KEPT = 500;
/** Events that get a mark, and its sign; `request` and the like are in the list alone. @type {Record<string, string>} */
const SIGNS = { state: "\u25c6", trip: "\u2716", note: "\u270e", plan: "\u25b8", fault: "\u2716", missed: "\u25be" };

export class Marks {
  constructor() {
    /** @type {import("./trace_plot.js").Mark[]} */
    this.all = [];
  }

  /** @param {{t_ns: number, kind: string, message: string}[]} events oldest first @param {number} epoch_s */
  replace(events, epoch_s) {
    this.all.length = 0;
    for (const event of events) this.add(event, epoch_s);
  }

  /** @param {{t_ns: number, kind: string, message: string}} event @param {number} epoch_s */
  add(event, epoch_s) {
    const kind = event.kind === "state" && event.message.includes("TRIPPED") ? "trip" : event.kind;
    const sign = SIGNS[kind];
    if (sign === undefined) return;
    this.all.push({ t_s: event.t_ns / 1e9 - epoch_s, kind: kind === "fault" ? "trip" : kind, sign, text: event.message });
    if (this.all.length > KEPT) this.all.shift();
  }

  /** The mark within `within_s` of a time, or null. @param {number} t_s @param {number} within_s */
  near(t_s, within_s) {
    let best = null;
    for (const mark of this.all) {
      const off = Math.abs(mark.t_s - t_s);
      if (off <= within_s && (best === null || off < Math.abs(best.t_s - t_s))) best = mark;
    }
    return best;
  }
}
