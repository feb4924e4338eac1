/** One plot over time: axes and cursor by uPlot, the signals of a group over them, with their values next to it. */

import uPlot from "./vendor/uPlot.esm.js";
import { InView, element, setText } from "./dom.js";
import { decimals, number, STEPS, steadyRange, TIME_STEPS_s } from "./format.js";
import { titleOf } from "./signals.js";
import { colour } from "./theme.js";
import { TraceCanvas } from "./trace_canvas.js";

const LEAST_WIDTH = { A: 0.5, Hz: 0.05, rad: 0.1 };
const FONT = '11px system-ui, "DejaVu Sans", sans-serif';
export const AXIS_PX = 46;
export const SYNC = "motord";
const NO_AXES = { from_s: NaN, to_s: NaN, min: NaN, max: NaN, live: false, old: false };

/** @typedef {import("./signals.js").Trace} Trace */
/** @typedef {import("./buckets.js").Buckets} Buckets */
/** @typedef {import("./trace_canvas.js").Limit} Limit */
/** @typedef {import("./trace_canvas.js").Mark} Mark */

export class TracePlot {
  /**
   * @param {string} group
   * @param {Trace[]} traces those shown
   * @param {{limits: () => Limit[], marks: () => Mark[], axis: boolean,
   *   old: () => boolean, time: (t_s: number, step_s: number) => string, select: (from: number, to: number) => void,
   *   cursor: (at: number | null) => void, shown: () => void}} host selection and cursor as shares of the window
   */
  constructor(group, traces, host) {
    this.group = group;
    this._traces = traces;
    this._host = host;
    this._range = new Float64Array([-1, 1]);
    this._width = 0;
    this._extent = new Float64Array(2);
    this._axes = NO_AXES; // as they are drawn
    /** @type {TraceCanvas | null} */
    this._traceCanvas = null;
    this._values = traces.map(() => element("span", { class: "value" }));
    this.canvas = element("div", { class: "plot" });
    this.element = element("div", { class: "trace-row" }, this._legend(), this.canvas);
    this._inView = new InView(this.canvas, host.shown);
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

  /** Make it anew, for a theme or a layout. @param {Buckets} buckets */
  build(buckets) {
    this.uplot?.destroy();
    this.uplot = null;
    const { width, height } = this._size();
    if (width < 20 || height < 20) return;
    this._axes = NO_AXES;
    this.uplot = new uPlot(this._options(width, height), [[0, 1]], this.canvas);
    this._drawAxes(-1, 0, true);
    this._overlay(buckets);
  }

  /** Fit it to its place and to other rows of buckets; a selection that is being drawn goes on. @param {Buckets} buckets */
  fit(buckets) {
    const { uplot } = this;
    const size = this._size();
    if (uplot === null || size.width < 20 || size.height < 20) return this.build(buckets);
    if (size.width !== uplot.width || size.height !== uplot.height) uplot.batch(() => uplot.setSize(size));
    this._overlay(buckets);
  }

  /** Whether it has the size of its place. */
  get fits() {
    const { width, height } = this._size();
    return this.uplot !== null && width === this.uplot.width && height === this.uplot.height;
  }

  _size() {
    return { width: this.canvas.clientWidth, height: this.canvas.clientHeight };
  }

  /** @param {Buckets} buckets */
  _overlay(buckets) {
    const { over } = this.uplot;
    this._width = over.clientWidth;
    this._traceCanvas?.element.remove();
    this._traceCanvas = new TraceCanvas(this._width, over.clientHeight, this._traces, buckets);
    over.prepend(this._traceCanvas.element);
  }

  /** @param {number} width @param {number} height */
  _options(width, height) {
    const soft = colour("soft");
    const grid = { stroke: colour("grid"), width: 1 };
    const axis = { stroke: soft, font: FONT, grid, ticks: { show: false }, gap: 4 };
    const space = this._host.axis ? 22 : 6;
    const scale = { time: false, auto: false, range: (/** @type {any} */ _u, /** @type {number} */ min, /** @type {number} */ max) => [min, max] };
    return {
      width, height, padding: [8, 16, this._host.axis ? 0 : 2, 0], legend: { show: false }, pxAlign: 0,
      scales: { x: scale, y: scale },
      axes: [
        { ...axis, size: space, space: 80, incrs: TIME_STEPS_s,
          values: (/** @type {any} */ _u, /** @type {number[]} */ at, /** @type {number} */ _a, /** @type {number} */ _s, /** @type {number} */ step) => at.map((t) => (this._host.axis ? this._host.time(t, step) : "")) },
        { ...axis, scale: "y", size: AXIS_PX, space: 24, incrs: STEPS,
          values: (/** @type {any} */ _u, /** @type {number[]} */ at, /** @type {number} */ _a, /** @type {number} */ _s, /** @type {number} */ step) => at.map((v) => number(v, decimals(step))) },
      ],
      series: [{}],
      cursor: {
        sync: { key: SYNC, setSeries: false, scales: ["x", null] }, y: false, points: { show: false },
        drag: { x: true, y: false, setScale: false }, bind: { dblclick: () => null },
      },
      hooks: { setCursor: [(/** @type {any} */ u) => this._cursor(u)], setSelect: [(/** @type {any} */ u) => this._selected(u)] },
    };
  }

  /**
   * Draw a window of time. The axis of a live one counts back from its end, so that axes and grid stand still
   * and are drawn again only with another span or range of values.
   * @param {Buckets} buckets
   * @param {number} to_s
   * @param {number} span_s
   * @param {boolean} live
   */
  draw(buckets, to_s, span_s, live) {
    if (this.uplot === null || !this._inView.now) return;
    this._extent[0] = Infinity;
    this._extent[1] = -Infinity;
    for (const trace of this._traces) buckets.extend(trace.name, this._extent);
    const [limit] = this._host.limits();
    const least = limit ? limit.value / 30 : LEAST_WIDTH[/** @type {keyof typeof LEAST_WIDTH} */ (this._traces[0]?.unit)] ?? 0.1;
    steadyRange(this._extent[0], this._extent[1], this._range, least);
    const [min, max] = this._range;
    this._drawAxes(live ? -span_s : to_s - span_s, live ? 0 : to_s, live);
    this._traceCanvas?.draw(buckets, { to_s, span_s, min, max }, this._host.limits(), this._host.marks(), this.group === "torque");
  }

  /** @param {number} from_s @param {number} to_s @param {boolean} live */
  _drawAxes(from_s, to_s, live) {
    const [min, max] = this._range;
    const { uplot, _axes: axes } = this;
    const old = this._host.old();
    if (axes.from_s === from_s && axes.to_s === to_s && axes.min === min && axes.max === max && axes.live === live && axes.old === old) return;
    this._axes = { from_s, to_s, min, max, live, old };
    uplot.batch(() => {
      uplot.setScale("x", { min: from_s, max: to_s });
      uplot.setScale("y", { min, max });
    });
    if (axes.old !== old) uplot.redraw(false, true); // the same scales with another name at their end
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
  _cursor(u) {
    const { left } = u.cursor;
    this._host.cursor(left === null || left === undefined || left < 0 ? null : left / this._width);
  }

  /** @param {any} u */
  _selected(u) {
    if (u.cursor.event?.type !== "mouseup") return; // still drawn, or only moved along
    const { left, width } = u.select;
    if (width > 4) this._host.select(left / this._width, (left + width) / this._width);
    u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  }
}

/** A value, or from minimum to maximum where they differ. @param {number} low @param {number} high @param {number} digits */
function spanned(low, high, digits) {
  const [from, to] = [number(low, digits), number(high, digits)];
  return from === to ? from : `${number(low, Math.max(0, digits - 1))} \u2026 ${number(high, Math.max(0, digits - 1))}`;
}
