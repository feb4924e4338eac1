/** Estimates with their 95 % intervals as a small plot, and a curve; drawn as SVG. */

import { svg } from "./dom.js";
import { commonDigits, number, significant } from "./format.js";

const WIDTH = 330;
const ROW = 22;

/**
 * A row for each estimate: name, interval, value.
 * @param {{name: string, value: number, low: number, high: number}[]} estimates with their intervals
 * @param {number} nominal drawn as a line
 * @param {number} least decimals
 * @param {string} unit
 */
export function intervalPlot(estimates, nominal, least, unit) {
  const digits = commonDigits(estimates.map(({ low, high }) => (high - low) / 2), least);
  const reach = Math.max(1e-9, ...estimates.flatMap(({ low, high }) => [Math.abs(low - nominal), Math.abs(high - nominal)]));
  const [from, to] = [34, WIDTH - 122];
  const x = (/** @type {number} */ value) => (from + to) / 2 + ((value - nominal) / reach) * (to - from) * 0.46;
  const height = ROW * estimates.length + 16;
  const rows = estimates.flatMap(({ name, value, low, high }, i) => {
    const y = ROW * i + ROW / 2;
    return [
      svg("text", { class: "name", x: 0, y: y + 4 }, name),
      svg("line", { class: "rail", x1: from, x2: to, y1: y, y2: y }),
      svg("line", { class: "interval", x1: x(low), x2: x(high), y1: y, y2: y }),
      svg("circle", { class: "estimate", cx: x(value), cy: y, r: 4 }),
      svg("text", { class: "number", x: WIDTH, y: y + 4 }, `${number(value, digits)} \u00b1 ${number((high - low) / 2, digits)}${unit && ` ${unit}`}`),
    ];
  });
  const words = estimates.map(({ name, value, low, high }) => `${name} ${number(value, digits)}, from ${number(low, digits)} to ${number(high, digits)} ${unit}`).join("; ");
  return svg("svg", { class: "intervals", viewBox: `0 0 ${WIDTH} ${height}`, role: "img", "aria-label": words },
    svg("line", { class: "nominal", x1: x(nominal), x2: x(nominal), y1: 2, y2: ROW * estimates.length }),
    svg("text", { class: "tick", x: x(nominal), y: height - 3 }, number(nominal, 0)),
    ...rows);
}

/** A curve over one turn. @param {number[]} values @param {string} unit */
export function turnCurve(values, unit) {
  const height = 92;
  const [left, right, top, bottom] = [44, WIDTH - 4, 6, height - 16];
  const high = Math.max(...values.map(Math.abs), 1e-9);
  const y = (/** @type {number} */ v) => (top + bottom) / 2 - (v / high) * ((bottom - top) / 2);
  const step = Math.max(1, Math.floor(values.length / 1024));
  const points = values.filter((_, i) => i % step === 0).map((v, i, all) => `${(left + ((right - left) * i) / (all.length - 1)).toFixed(1)},${y(v).toFixed(1)}`);
  return svg("svg", { class: "curve", viewBox: `0 0 ${WIDTH} ${height}`, role: "img", "aria-label": `Cogging torque over one turn, at most ${significant(high)} ${unit}` },
    svg("line", { class: "rail", x1: left, x2: right, y1: y(0), y2: y(0) }),
    svg("polyline", { class: "line", points: points.join(" ") }),
    svg("text", { class: "axis", x: left - 4, y: y(high) + 8 }, significant(high, 2)),
    svg("text", { class: "axis", x: left - 4, y: y(0) + 4 }, "0"),
    svg("text", { class: "axis", x: left - 4, y: y(-high) }, significant(-high, 2)),
    svg("text", { class: "tick", x: left, y: height - 3 }, "0\u00b0"),
    svg("text", { class: "tick", x: (left + right) / 2, y: height - 3 }, "180\u00b0"),
    svg("text", { class: "tick end", x: right, y: height - 3 }, "360\u00b0"));
}
