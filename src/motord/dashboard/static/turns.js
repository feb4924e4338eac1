/** Torque over the angle of the last turns, and its spectrum over the orders of the turn. */

import { bars, Chart } from "./chart.js";
import { byId, setAttribute, setHidden, setText } from "./dom.js";
import { number, steadyRange } from "./format.js";

const LABELLED = 4;
const DEGREES = [0, 90, 180, 270, 360];
/** @type {[number, number]} */
const DEGREES_SHOWN = [0, 360];
/** As many as the server keeps, the newest last: it stands out. */
const TURNS = Array.from({ length: 8 }, (_, k) => (k === 7 ? { colour: "trace-1", width: 1.75 } : { colour: "soft", width: 1, alpha: 0.2 + 0.05 * k }));
const ORDERS = ["trace-1", "trace-2"].map((colour) => ({ colour, width: 0, filled: true, paths: bars }));

export class Turns {
  /** @param {import("./state.js").Bench} bench */
  constructor(bench) {
    this._bench = bench;
    /** @type {any} */
    this._header = null;
    this._floats = new Float32Array(0);
    this._range = new Float64Array([NaN, NaN]);
    this._top = new Float64Array([NaN, NaN]);
    this._angle = new Chart(byId("turns-chart"), { ticks: DEGREES, label: degrees }, {}, TURNS, () => this._turnsShown(), () => this._levels());
    this._spectrum = new Chart(byId("orders-chart"), {}, {}, ORDERS, () => this._ordersShown(), () => this._orderNames());
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
    const { turns, bins, orders, calibrated } = this._header;
    setHidden(byId("turns-empty"), turns > 0);
    if (turns === 0) return;
    let [low, high] = [Infinity, -Infinity];
    for (let i = (turns - 1) * bins; i < turns * bins; i++) {
      if (this._floats[i] < low) low = this._floats[i];
      if (this._floats[i] > high) high = this._floats[i];
    }
    this._largest = largest(orders, (order) => this._amplitude(order), LABELLED);
    const main = this._largest[0];
    setText(byId("turns-caption"), `newest of ${turns}: ${spread(high - low, this._header, this._bench.sensorPassesMean, this._bench.torqueDigits)}`);
    const marked = calibrated.length ? "; \u25b4\u00a0calibrated" : "";
    setText(byId("orders-caption"), main === undefined ? "no turn at a steady set-point" : `order\u00a0${main}: ${number(this._amplitude(main), this._bench.torqueDigits + 1)}\u00a0Nm${marked}`);
    setAttribute(byId("turns-chart"), "aria-label", `Torque over angle: ${byId("turns-caption").textContent}`);
    setAttribute(byId("orders-chart"), "aria-label", `Amplitude by order: ${byId("orders-caption").textContent}`);
  }

  _turnsShown() {
    if (!this._header?.turns) return { x: DEGREES_SHOWN, y: [-1, 1], data: [[0], ...TURNS.map(() => [null])] };
    const { turns, bins, set_Nm } = this._header;
    let [low, high] = this._bench.sensorPassesMean ? [set_Nm, set_Nm] : [0, 0];
    for (let i = 0; i < turns * bins; i++) {
      const value = this._floats[i];
      if (value < low) low = value;
      if (value > high) high = value;
    }
    steadyRange(low, high, this._range, this._bench.torqueLimit_Nm / 60);
    const none = Array(bins).fill(null);
    const rows = TURNS.map((_, k) => {
      const turn = turns - TURNS.length + k;
      return turn < 0 ? none : this._floats.subarray(turn * bins, (turn + 1) * bins);
    });
    return { x: DEGREES_SHOWN, y: [...this._range], data: [none.map((_, i) => ((i + 0.5) * 360) / bins), ...rows] };
  }

  _levels() {
    if (!this._header?.turns || !this._bench.sensorPassesMean) return;
    for (const { value, label } of this._bench.torqueLimits) this._angle.level(value, label, { colour: "limit", dash: [8, 3, 2, 3] });
    this._angle.level(this._header.set_Nm, "set", { colour: "trace-set", dash: [6, 4] });
  }

  _ordersShown() {
    if (!this._header?.turns) return { x: [0, 100], y: [0, 1], data: [[0], [null], [null]] };
    const { orders, calibrated } = this._header;
    let high = 0;
    let last = 16;
    for (let order = 1; order < orders; order++) if (this._amplitude(order) > high) high = this._amplitude(order);
    for (let order = 1; order < orders; order++) if (this._amplitude(order) > 0.02 * high) last = Math.max(last, order);
    for (const order of calibrated) if (order < orders) last = Math.max(last, order);
    const least = this._bench.torqueLimit_Nm / 600;
    steadyRange(0, Math.max(1.08 * high, least), this._top, least);
    const shown = Array.from({ length: Math.min(orders - 1, Math.ceil((last + 4) / 16) * 16) }, (_, i) => i + 1);
    const row = (/** @type {boolean} */ own) => shown.map((order) => (calibrated.includes(order) === own && this._amplitude(order) > 0 ? this._amplitude(order) : null));
    return { x: [0, shown.length], y: [0, this._top[1]], data: [shown, row(false), row(true)] };
  }

  _orderNames() {
    const { orders, calibrated } = this._header ?? {};
    for (const order of new Set([...(calibrated ?? []), ...(this._largest ?? [])])) {
      if (order < orders) this._spectrum.text(`${calibrated.includes(order) ? "\u25b4" : ""}${order}`, order, this._amplitude(order) || 0);
    }
  }
}

/** What a turn's torque spans and about which set-point; a moved one is in it. Pure. @param {number} span_Nm @param {{set_Nm: number, steady: boolean}} header @param {boolean} mean @param {number} digits */
export function spread(span_Nm, { set_Nm, steady }, mean, digits = 2) {
  const set = `${number(set_Nm, digits)}\u00a0Nm`;
  const about = !steady ? "as the set-point moved" : mean ? `about ${set}` : `at ${set} (no\u00a0mean)`;
  return `${number(span_Nm, digits)}\u00a0Nm\u00a0p-p ${about}`;
}

const degrees = (/** @type {number} */ value) => `${value}\u00b0`;

/** The orders of the largest amplitudes, from 1 on, the largest first. @param {number} orders @param {(order: number) => number} amplitude @param {number} most */
export function largest(orders, amplitude, most) {
  const found = [];
  for (let order = 1; order < orders; order++) if (amplitude(order) > 0) found.push(order);
  found.sort((a, b) => amplitude(b) - amplitude(a));
  return found.filter((order, i) => i === 0 || amplitude(order) > 0.25 * amplitude(found[0])).slice(0, most);
}
