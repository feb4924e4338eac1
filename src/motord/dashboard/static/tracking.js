/** The calibration in force as ordinary operation shows it: each quantity against its value in force. */

import { byId, element } from "./dom.js";
import { plusMinus } from "./format.js";

/**
 * @typedef {{name: string, meaning: string, unit: string, value: number, half_width: number, in_force: number,
 *   in_force_half_width: number, departed: boolean}} Quantity
 */

export class TrackedQuantities {
  /** @param {import("./state.js").Bench} bench */
  constructor(bench) {
    this._shown = "";
    bench.on("state", (state) => this._show(state.tracking ?? null));
  }

  /** @param {any} tracking as in the state */
  _show(tracking) {
    const key = tracking ? `${tracking.calibration} ${tracking.t_ns} ${tracking.turns} ${tracking.obstacle}` : "";
    if (key === this._shown) return;
    this._shown = key;
    byId("calibration-tracked").replaceChildren(...(tracking ? content(tracking) : []));
  }
}

/** @param {any} tracking */
function content(tracking) {
  const { quantities, unseen, obstacle } = tracking;
  const departed = quantities.filter((/** @type {Quantity} */ one) => one.departed).length;
  const verdict = departed ? `${departed} of ${quantities.length} have left their interval: check it, or adopt what is tracked (motord calibration adopt).` : "All within their intervals.";
  return [
    element("h4", {}, `Calibration, tracked over ${tracking.turns} turns, 95 %`),
    quantities.length ? element("p", { class: "about" }, verdict) : null,
    quantities.length ? table(quantities) : null,
    obstacle || unseen.length ? element("ul", { class: "hint" }, ...[obstacle, ...unseen.map((/** @type {string} */ text) => `not seen: ${text}`)].filter(Boolean).map((text) => element("li", {}, text))) : null,
  ].filter((one) => one !== null);
}

/** @param {Quantity[]} quantities */
function table(quantities) {
  const head = element("tr", {}, ...["quantity", "tracked", "in force"].map((text) => element("th", { scope: "col" }, text)));
  const rows = quantities.map((one) => element("tr", { class: one.departed ? "departed" : null, title: one.meaning },
    element("td", {}, `${one.departed ? "\u26a0 " : ""}${one.name}${one.unit && one.unit !== "1" ? `, ${one.unit}` : ""}`),
    element("td", {}, plusMinus(one.value, one.half_width)),
    element("td", {}, plusMinus(one.in_force, one.in_force_half_width))));
  return element("table", { class: "figures tracked" }, element("thead", {}, head), element("tbody", {}, ...rows));
}
