/** One plot over time: the signals of a group, limits, marks and cursor, with their values next to it. */

import uPlot from "./vendor/uPlot.esm.js";
import { bandPaths, noPaths } from "./bands.js";
import { element, setText } from "./dom.js";
import { number, steadyRange } from "./format.js";
import { titleOf } from "./signals.js";
import { colour } from "./theme.js";

const LEAST_WIDTH = { Nm: 0.2, A: 0.5, Hz: 0.05, rad: 0.1 };
const FONT = '11px system-ui, "DejaVu Sans", sans-serif';
export const AXIS_PX = 46;
export const SYNC = "motord";

/** @typedef {import("./signals.js").Trace} Trace */
/** @typedef {import("./buckets.js").Buckets} Buckets */
/** @typedef {{t_s: number, kind: string, sign: string, text: string}} Mark */

export class TracePlot {
  /**
   * @param {string} group
   * @param {Trace[]} traces those shown
   * @param {{limits: () => {value: number, label: string}[], marks: () => Mark[], axis: boolean,
   *   time: (t_s: number, step_s: number) => string, select: (from_s: number, to_s: number) => void,
   *   cursor: (t_s: number | null) => void}} host
   */
  constructor(group, traces, host) {
    this.group = group;
    this._traces = traces;
    this._host = host;
    this._range = new Float64Array([NaN, NaN]);
    this._extent = new Float64Array(2);
    this._window = { min: 0, max: 1 };
    this._scale = { min: 0, max: 1 };
    this._values = traces.map(() => element("span", { class: "value" }));
    this.canvas = element("div", { class: "plot" });
    this.element = element("div", { class: "trace-row" }, this._legend(), this.canvas);
    /** @type {any} */
    this.uplot = null;
  }

  _legend() {
    const rows = this._traces.map((trace, i) => {
      const tag = element("span", { class: `tag ${trace.colour}${trace.dash ? " dashed" : ""}` }, trace.tag);
      return element("div", { class: "readout", title: trace.label }, tag, this._values[i]);
    });
    const unit = this._traces[0]?.unit ?? "";
    const title = element("h3", {}, titleOf(this.group), element("span", { class: "unit" }, unit));
    return element("div", { class: "legend" }, title, ...rows);
  }

  /** Make it anew, for a size, a theme or a layout. @param {Buckets} buckets */
  build(buckets) {
    this.uplot?.destroy();
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width < 20 || height < 20) return;
    this._data = [buckets.time_s];
    for (const trace of this._traces) this._data.push(...(buckets.row(trace.name) ?? NO_ROWS(buckets)));
    this.uplot = new uPlot(this._options(width, height), this._data, this.canvas);
  }

  /** @param {number} width @param {number} height */
  _options(width, height) {
    const soft = colour("soft");
    const grid = { stroke: colour("grid"), width: 1 };
    const axis = { stroke: soft, font: FONT, grid, ticks: { show: false }, gap: 4 };
    const space = this._host.axis ? 22 : 6;
    return {
      width, height, padding: [8, 16, this._host.axis ? 0 : 2, 0], legend: { show: false }, pxAlign: 0,
      scales: {
        x: { time: false, auto: false, range: (/** @type {any} */ _u, /** @type {number} */ min, /** @type {number} */ max) => [min, max] },
        y: { auto: false, range: (/** @type {any} */ _u, /** @type {number} */ min, /** @type {number} */ max) => [min, max] },
      },
      axes: [
        { ...axis, size: space, space: 80, splits: (/** @type {any} */ u, /** @type {number} */ _a, /** @type {number} */ min, /** @type {number} */ max, /** @type {number} */ step) => this._splits(min, max, step),
          values: (/** @type {any} */ _u, /** @type {number[]} */ at, /** @type {number} */ _a, /** @type {number} */ _s, /** @type {number} */ step) => at.map((t) => (this._host.axis ? this._host.time(t, step) : "")) },
        { ...axis, scale: "y", size: AXIS_PX, space: 24,
          values: (/** @type {any} */ _u, /** @type {number[]} */ at, /** @type {number} */ _a, /** @type {number} */ _s, /** @type {number} */ step) => at.map((v) => number(v, decimals(step))) },
      ],
      series: [{}, ...this._traces.flatMap((trace) => this._series(trace))],
      cursor: {
        sync: { key: SYNC, setSeries: false, scales: ["x", null] }, y: false, points: { show: false },
        drag: { x: true, y: false, setScale: false }, bind: { dblclick: () => null },
      },
      hooks: { draw: [(/** @type {any} */ u) => this._drawOver(u)], setCursor: [(/** @type {any} */ u) => this._cursor(u)], setSelect: [(/** @type {any} */ u) => this._selected(u)] },
    };
  }

  /** The grid stands still while time runs: live, it is tied to the newest edge. @param {number} min @param {number} max @param {number} step */
  _splits(min, max, step) {
    const origin = this._host.time === undefined ? 0 : this._origin ?? 0;
    const splits = [];
    for (let k = Math.ceil((min - origin) / step - 1e-6); origin + k * step <= max + step * 1e-6; k++) splits.push(origin + k * step);
    return splits;
  }

  /** @param {Trace} trace */
  _series(trace) {
    const ink = colour(trace.colour);
    return [
      { scale: "y", auto: false, paths: noPaths, points: { show: false } },
      {
        scale: "y", auto: false, stroke: ink, width: trace.dash ? 1.25 : 1.1, dash: trace.dash,
        fill: trace.dash ? undefined : translucent(ink), paths: bandPaths, points: { show: false },
      },
    ];
  }

  /**
   * Draw a window of time.
   * @param {Buckets} buckets
   * @param {number} from_s
   * @param {number} to_s
   * @param {boolean} live
   */
  draw(buckets, from_s, to_s, live) {
    if (this.uplot === null) return;
    this._extent[0] = Infinity;
    this._extent[1] = -Infinity;
    for (const trace of this._traces) buckets.extend(trace.name, this._extent);
    const least = LEAST_WIDTH[/** @type {keyof typeof LEAST_WIDTH} */ (this._traces[0]?.unit)] ?? 0.1;
    steadyRange(this._extent[0], this._extent[1], this._range, least);
    if (Number.isNaN(this._range[0])) this._range.set([-1, 1]);
    this._window.min = from_s;
    this._window.max = to_s;
    this._scale.min = this._range[0];
    this._scale.max = this._range[1];
    this._origin = live ? to_s : 0;
    const { uplot } = this;
    uplot.batch(() => {
      uplot.setData(this._data, false);
      uplot.setScale("x", this._window);
      uplot.setScale("y", this._scale);
    });
  }

  /** Values at a time, from minimum to maximum, or the newest. @param {Buckets} buckets @param {number | null} t_s */
  showValues(buckets, t_s) {
    this._traces.forEach((trace, i) => {
      const at = t_s === null ? buckets.newest(trace.name) : buckets.at(t_s);
      const row = buckets.row(trace.name);
      const [low, high] = row && at >= 0 ? [row[0][at], row[1][at]] : [NaN, NaN];
      setText(this._values[i], t_s === null ? number((low + high) / 2, trace.digits) : spanned(low, high, trace.digits));
    });
  }

  /** @param {any} u */
  _drawOver(u) {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top - 8 * devicePixelRatio, bbox.width + 8 * devicePixelRatio, bbox.height + 8 * devicePixelRatio);
    ctx.clip();
    ctx.font = `${11 * devicePixelRatio}px system-ui, "DejaVu Sans", sans-serif`;
    ctx.lineWidth = devicePixelRatio;
    for (const limit of this._host.limits()) this._limit(u, ctx, limit);
    for (const mark of this._host.marks()) this._mark(u, ctx, mark);
    ctx.restore();
  }

  /** @param {any} u @param {CanvasRenderingContext2D} ctx @param {{value: number, label: string}} limit */
  _limit(u, ctx, { value, label }) {
    const { min, max } = u.scales.y;
    if (value < min || value > max) return;
    const y = Math.round(u.valToPos(value, "y", true)) + 0.5;
    ctx.strokeStyle = ctx.fillStyle = colour("limit");
    ctx.setLineDash([8 * devicePixelRatio, 3 * devicePixelRatio, 2 * devicePixelRatio, 3 * devicePixelRatio]);
    line(ctx, u.bbox.left, y, u.bbox.left + u.bbox.width, y);
    ctx.setLineDash([]);
    ctx.textAlign = "right";
    ctx.textBaseline = value > 0 ? "top" : "bottom";
    ctx.fillText(label, u.bbox.left + u.bbox.width - 4, y + (value > 0 ? 2 : -2));
  }

  /** @param {any} u @param {CanvasRenderingContext2D} ctx @param {Mark} mark */
  _mark(u, ctx, mark) {
    if (mark.t_s < u.scales.x.min || mark.t_s > u.scales.x.max) return;
    const x = Math.round(u.valToPos(mark.t_s, "x", true)) + 0.5;
    ctx.strokeStyle = ctx.fillStyle = colour(`mark-${mark.kind}`);
    ctx.setLineDash([2 * devicePixelRatio, 2 * devicePixelRatio]);
    line(ctx, x, u.bbox.top, x, u.bbox.top + u.bbox.height);
    ctx.setLineDash([]);
    if (this.group !== "torque") return;
    ctx.textAlign = "center";
    ctx.textBaseline = "top";
    ctx.fillText(mark.sign, x, u.bbox.top - 8 * devicePixelRatio);
  }

  /** @param {any} u */
  _cursor(u) {
    const { left } = u.cursor;
    this._host.cursor(left === null || left === undefined || left < 0 ? null : u.posToVal(left, "x"));
  }

  /** @param {any} u */
  _selected(u) {
    if (u.cursor.event?.type !== "mouseup") return; // still drawn, or only moved along
    const { left, width } = u.select;
    if (width > 4) this._host.select(u.posToVal(left, "x"), u.posToVal(left + width, "x"));
    u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  }
}

/** @param {Buckets} buckets */
const NO_ROWS = (buckets) => {
  const empty = new Float32Array(buckets.count).fill(NaN);
  return [empty, empty];
};

/** @param {CanvasRenderingContext2D} ctx @param {number} x0 @param {number} y0 @param {number} x1 @param {number} y1 */
function line(ctx, x0, y0, x1, y1) {
  ctx.beginPath();
  ctx.moveTo(x0, y0);
  ctx.lineTo(x1, y1);
  ctx.stroke();
}

/** @param {string} rgb */
const translucent = (rgb) => rgb.replace("rgb(", "rgba(").replace(")", ", 0.3)");

/** Decimals that distinguish steps of `step`. @param {number} step */
const decimals = (step) => Math.max(0, Math.min(6, Math.ceil(-Math.log10(step) - 1e-9)));

/** A value, or from minimum to maximum where they differ. @param {number} low @param {number} high @param {number} digits */
function spanned(low, high, digits) {
  const [from, to] = [number(low, digits), number(high, digits)];
  return from === to ? from : `${number(low, Math.max(0, digits - 1))} \u2026 ${number(high, Math.max(0, digits - 1))}`;
}
