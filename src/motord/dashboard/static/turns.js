/** Torque over the angle of the last turns, and its spectrum over the orders of the turn. */

import { Chart } from "./chart.js";
import { byId, setAttribute, setText } from "./dom.js";
import { number, steadyRange } from "./format.js";

const LABELLED = 4;
const DEGREES = [0, 90, 180, 270, 360];

export class Turns {
  /** @param {import("./state.js").Bench} bench */
  constructor(bench) {
    this._bench = bench;
    /** @type {any} */
    this._header = null;
    this._floats = new Float32Array(0);
    this._range = new Float64Array([NaN, NaN]);
    this._top = new Float64Array([NaN, NaN]);
    this._angle = new Chart(byId("turns-canvas"), () => this._drawAngle());
    this._spectrum = new Chart(byId("orders-canvas"), () => this._drawOrders());
    bench.on("turns", (header, floats) => this._take(header, floats));
  }

  /** @param {any} header @param {Float32Array} floats */
  _take(header, floats) {
    const { turns, bins, orders } = header;
    if (floats.length < turns * bins + orders) throw new Error(`turns: ${floats.length} floats`);
    this._header = header;
    this._floats = floats;
    this._summarise();
    this._angle.redraw();
    this._spectrum.redraw();
  }

  /** @param {number} order */
  _amplitude(order) {
    const { turns, bins } = this._header;
    return this._floats[turns * bins + order];
  }

  _summarise() {
    const { turns, bins, orders, set_Nm } = this._header;
    byId("turns-empty").hidden = turns > 0;
    if (turns === 0) return;
    let [low, high] = [Infinity, -Infinity];
    for (let i = (turns - 1) * bins; i < turns * bins; i++) {
      if (this._floats[i] < low) low = this._floats[i];
      if (this._floats[i] > high) high = this._floats[i];
    }
    this._largest = largest(orders, (order) => this._amplitude(order), LABELLED);
    const main = this._largest[0];
    const about = this._bench.sensorPassesMean ? `about ${number(set_Nm, 2)}` : `at ${number(set_Nm, 2)} (no mean)`;
    setText(byId("turns-caption"), `last ${turns === 1 ? "turn" : `${turns} turns`}: ${number(high - low, 2)} Nm p-p ${about}`);
    setText(byId("orders-caption"), main === undefined ? "no turn at a steady set-point" : `order ${main}: ${number(this._amplitude(main), 3)} Nm; \u25b4 calibrated`);
    setAttribute(byId("turns-canvas"), "aria-label", `Torque over angle: ${byId("turns-caption").textContent}`);
    setAttribute(byId("orders-canvas"), "aria-label", `Amplitude by order: ${byId("orders-caption").textContent}`);
  }

  _drawAngle() {
    if (!this._header?.turns) return this._angle.begin({ from: 0, to: 360, ticks: DEGREES, label: degrees }, { from: -1, to: 1 });
    const { turns, bins, set_Nm } = this._header;
    const mean = this._bench.sensorPassesMean;
    let [low, high] = mean ? [set_Nm, set_Nm] : [0, 0];
    for (let i = 0; i < turns * bins; i++) {
      const value = this._floats[i];
      if (value < low) low = value;
      if (value > high) high = value;
    }
    steadyRange(low, high, this._range, 0.1);
    this._angle.begin({ from: 0, to: 360, ticks: DEGREES, label: degrees }, { from: this._range[0], to: this._range[1] });
    for (let turn = 0; turn < turns; turn++) {
      const newest = turn === turns - 1;
      const style = { colour: newest ? "trace-1" : "soft", width: newest ? 1.75 : 1, alpha: newest ? 1 : 0.2 + (0.35 * turn) / turns };
      this._angle.line(bins, (i) => ((i + 0.5) * 360) / bins, (i) => this._floats[turn * bins + i], style);
    }
    if (!mean) return;
    for (const { value, label } of this._bench.torqueLimits) this._angle.level(value, label, { colour: "limit", dash: [8, 3, 2, 3] });
    this._angle.level(set_Nm, "set", { colour: "trace-set", dash: [6, 4] });
  }

  _drawOrders() {
    if (!this._header?.turns) return this._spectrum.begin({ from: 0, to: 100 }, { from: 0, to: 1 });
    const { orders, calibrated } = this._header;
    let high = 0;
    let last = 16;
    for (let order = 1; order < orders; order++) if (this._amplitude(order) > high) high = this._amplitude(order);
    for (let order = 1; order < orders; order++) if (this._amplitude(order) > 0.02 * high) last = Math.max(last, order);
    for (const order of calibrated) if (order < orders) last = Math.max(last, order);
    steadyRange(0, Math.max(1.08 * high, 0.01), this._top, 0.01);
    const to = Math.min(orders - 1, Math.ceil((last + 4) / 16) * 16);
    this._spectrum.begin({ from: 0, to }, { from: 0, to: this._top[1] });
    const width = Math.max(1.5, Math.min(9, (this._spectrum.right - this._spectrum.left) / to - 1));
    for (let order = 1; order <= to; order++) {
      const amplitude = this._amplitude(order);
      if (amplitude > 0) this._spectrum.bar(order, width, amplitude, calibrated.includes(order) ? "trace-2" : "trace-1");
    }
    for (const order of new Set([...calibrated, ...(this._largest ?? [])])) {
      const text = `${calibrated.includes(order) ? "\u25b4" : ""}${order}`;
      if (order <= to) this._spectrum.text(text, this._spectrum.x(order), this._spectrum.y(this._amplitude(order) || 0) - 1, "ink");
    }
  }
}

const degrees = (/** @type {number} */ value) => `${value}\u00b0`;

/** The orders of the largest amplitudes, from 1 on, the largest first. @param {number} orders @param {(order: number) => number} amplitude @param {number} most */
export function largest(orders, amplitude, most) {
  const found = [];
  for (let order = 1; order < orders; order++) if (amplitude(order) > 0) found.push(order);
  found.sort((a, b) => amplitude(b) - amplitude(a));
  return found.filter((order, i) => i === 0 || amplitude(order) > 0.25 * amplitude(found[0])).slice(0, most);
}
