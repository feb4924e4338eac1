/** The calibration in force as ordinary operation shows it: each quantity against its value in force. */

import { byId, element, setHidden, setText } from "./dom.js";
import { plusMinus } from "./format.js";

/**
 * @typedef {{name: string, meaning: string, unit: string, value: number, half_width: number, in_force: number,
 *   in_force_half_width: number, departed: boolean, adoptable: boolean}} Quantity
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
    setHidden(byId("calibration-tracked"), tracking === null);
    if (tracking === null) return;
    setText(byId("tracked-verdict"), verdict(tracking));
    byId("tracked-quantities").replaceChildren(table(tracking.quantities), notes(tracking));
  }
}

/** @param {{quantities: Quantity[], turns: number, obstacle: string}} tracking */
function verdict({ quantities, turns, obstacle }) {
  if (quantities.length === 0) return `Tracked: ${obstacle || "nothing known yet"}`;
  const departed = quantities.filter((one) => one.departed);
  if (departed.length === 0) return `Tracked over ${turns} turns: all ${quantities.length} quantities within their intervals`;
  const names = departed.map((one) => one.name).join(", ");
  const remedy = departed.some((one) => one.adoptable) ? "motord calibration adopt takes over what is tracked" : "Calibrate again";
  return `\u26a0 Tracked over ${turns} turns: ${names} left ${departed.length === 1 ? "its interval" : "their intervals"}. ${remedy}.`;
}

/** @param {{unseen: string[], obstacle: string}} tracking */
function notes({ unseen, obstacle }) {
  const said = [obstacle, ...unseen.map((what) => `not seen: ${what}`)].filter(Boolean);
  return element("ul", { class: "hint" }, ...said.map((text) => element("li", {}, text)));
}

/** @param {Quantity[]} quantities with 95 % intervals */
function table(quantities) {
  const head = element("tr", {}, ...["quantity", "tracked", "in force"].map((text) => element("th", { scope: "col" }, text)));
  const rows = quantities.map((one) => element("tr", { class: one.departed ? "departed" : null, title: one.meaning },
    element("td", {}, `${one.departed ? "\u26a0 " : ""}${one.name}${one.unit && one.unit !== "1" ? `, ${one.unit}` : ""}`),
    element("td", {}, plusMinus(one.value, one.half_width)),
    element("td", {}, plusMinus(one.in_force, one.in_force_half_width))));
  return element("table", { class: "figures tracked" }, element("thead", {}, head), element("tbody", {}, ...rows));
}
