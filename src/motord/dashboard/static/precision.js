/** How precise a plan with targets is by now: half-widths of 95 % intervals, which shrink as it runs. */

import { element, setHidden, svg } from "./dom.js";
import { nameAndUnit, significant } from "./format.js";

const HALF_WIDTH = 50;
/** Targets from the middle of a bar to its end: a wider interval fills it. */
const TARGETS_SHOWN = 4;

/**
 * @typedef {{targets?: Record<string, number>, precision?: Record<string, number>, obstacle?: string}} Known of `PlanView`
 * @typedef {{words: string, unit: string, half: number | null, target: number, reached: boolean}} Quantity
 */

/** Each quantity that a plan is to find out. Pure. @param {Known} plan @returns {Quantity[]} */
export function quantities({ targets = {}, precision = {} }) {
  return Object.entries(targets).map(([name, target]) => {
    const half = precision[name] ?? null;
    return { ...nameAndUnit(name), half, target, reached: half !== null && half <= target };
  });
}

/** Half the length of an interval in a bar that has its target at a quarter. Pure. @param {Quantity} quantity */
export function barLength({ half, target }) {
  return half === null ? HALF_WIDTH : Math.min(half / (TARGETS_SHOWN * target), 1) * HALF_WIDTH;
}

export class PlanPrecision {
  /** @param {any} box what it is shown in */
  constructor(box) {
    this._box = box;
    this._shown = "";
  }

  /** Show it if it is another one; nothing for a plan without targets. @param {Known} plan */
  show(plan) {
    const known = JSON.stringify([plan.targets, plan.precision, plan.obstacle]);
    if (known === this._shown) return;
    this._shown = known;
    const rows = quantities(plan);
    setHidden(this._box, rows.length === 0);
    const head = element("tr", {}, ...["quantity", "\u00b1 95 %", "target", "interval", "state"].map((text) => element("th", { scope: "col" }, text)));
    this._box.replaceChildren(
      element("table", { class: "figures" }, element("thead", {}, head), element("tbody", {}, ...rows.map(row))),
      plan.obstacle ? element("p", { class: "small warning" }, `\u26a0 Does not end early: ${plan.obstacle}`) : "");
  }
}

/** @param {Quantity} quantity */
function row(quantity) {
  const { words, unit, half, target, reached } = quantity;
  return element("tr", { "data-reached": reached },
    element("td", {}, words), element("td", {}, half === null ? "?" : significant(half)),
    element("td", {}, `${significant(target, 2)}${unit && ` ${unit}`}`), element("td", {}, bar(quantity)),
    element("td", {}, reached ? "\u2714 reached" : half === null ? "not known yet" : "not yet"));
}

/** @param {Quantity} quantity */
function bar(quantity) {
  const [length, mark] = [barLength(quantity), HALF_WIDTH / TARGETS_SHOWN];
  const at = (/** @type {number} */ x) => svg("line", { class: "nominal", x1: x, x2: x, y1: 1, y2: 11 });
  return svg("svg", { class: "bar", viewBox: `${-HALF_WIDTH} 0 ${2 * HALF_WIDTH} 12`, "aria-hidden": "true" },
    svg("line", { class: "rail", x1: -HALF_WIDTH, x2: HALF_WIDTH, y1: 6, y2: 6 }),
    svg("line", { class: quantity.half === null ? "rail" : "interval", x1: -length, x2: length, y1: 6, y2: 6 }), at(-mark), at(mark));
}
