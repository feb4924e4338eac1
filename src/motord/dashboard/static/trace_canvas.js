/** The canvas over a plot's grid: signals, limits and marks of a window of time. */

import { Raster, rgbOf } from "./raster.js";
import { element } from "./dom.js";
import { colour } from "./theme.js";

const LINE_PX = 1;
/** Above the plot are the signs of marks; half of the last one is to its right. */
const MARGIN_PX = 8;
const FONT = 'px system-ui, "DejaVu Sans", sans-serif';

/** @typedef {import("./buckets.js").Buckets} Buckets */
/** @typedef {import("./signals.js").Trace} Trace */
/** @typedef {{to_s: number, span_s: number, min: number, max: number}} View */
/** @typedef {{value: number, label: string}} Limit */
/** @typedef {{t_s: number, kind: string, sign: string, text: string}} Mark */

export class TraceCanvas {
  /** @param {number} width px of the page @param {number} height @param {Trace[]} traces @param {Buckets} buckets */
  constructor(width, height, traces, buckets) {
    this._width = width;
    this._height = height;
    const scale = (this._scale = devicePixelRatio);
    this.element = element("canvas", { class: "traces" });
    this.element.width = Math.round((width + MARGIN_PX) * scale);
    this.element.height = Math.round((height + MARGIN_PX) * scale);
    this.element.style.width = `${width + MARGIN_PX}px`;
    this.element.style.height = `${height + MARGIN_PX}px`;
    this._context = /** @type {CanvasRenderingContext2D} */ (this.element.getContext("2d", { willReadFrequently: true }));
    this._raster = new Raster(Math.round(width * scale), Math.round(height * scale), LINE_PX * scale);
    this._image = new ImageData(new Uint8ClampedArray(this._raster.pixels.buffer), this._raster.width, this._raster.height);
    /** @type {import("./raster.js").Band[]} */
    this._bands = [];
    for (const { name, colour: ink, dash } of traces) {
      const rows = buckets.row(name);
      if (rows === null) continue;
      this._bands.push({ low: rows[0], high: rows[1], rgb: rgbOf(colour(ink)), dash: dash?.map((px) => px * scale) ?? null });
    }
  }

  /** @param {Buckets} buckets @param {View} view @param {Limit[]} limits @param {Mark[]} marks @param {boolean} signs */
  draw(buckets, view, limits, marks, signs) {
    const { _context: context, _scale: scale } = this;
    this._raster.draw(buckets, this._bands, view.to_s, view.span_s, view);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, this.element.width, this.element.height);
    context.putImageData(this._image, 0, this.element.height - this._raster.height);
    context.setTransform(scale, 0, 0, scale, 0, this.element.height - this._height * scale);
    context.font = `11${FONT}`;
    context.lineWidth = 1;
    for (const limit of limits) if (limit.value > view.min && limit.value < view.max) this._limit(view, limit);
    for (const mark of marks) if (mark.t_s > view.to_s - view.span_s && mark.t_s < view.to_s) this._mark(view, mark, signs);
  }

  /** @param {View} view @param {Limit} limit */
  _limit({ min, max }, { value, label }) {
    const { _context: context } = this;
    const y = Math.round(((max - value) / (max - min)) * this._height) + 0.5;
    context.strokeStyle = context.fillStyle = colour("limit");
    context.setLineDash([8, 3, 2, 3]);
    this._line(0, y, this._width, y);
    context.textAlign = "right";
    context.textBaseline = value > 0 ? "top" : "bottom";
    context.fillText(label, this._width - 4, y + (value > 0 ? 2 : -2));
  }

  /** @param {View} view @param {Mark} mark @param {boolean} signed */
  _mark({ to_s, span_s }, mark, signed) {
    const { _context: context } = this;
    const x = Math.round((1 - (to_s - mark.t_s) / span_s) * this._width) + 0.5;
    context.strokeStyle = context.fillStyle = colour(`mark-${mark.kind}`);
    context.setLineDash([2, 2]);
    this._line(x, 0, x, this._height);
    if (!signed) return;
    context.textAlign = "center";
    context.textBaseline = "top";
    context.fillText(mark.sign, x, -MARGIN_PX);
  }

  /** @param {number} x0 @param {number} y0 @param {number} x1 @param {number} y1 */
  _line(x0, y0, x1, y1) {
    this._context.beginPath();
    this._context.moveTo(x0, y0);
    this._context.lineTo(x1, y1);
    this._context.stroke();
  }
}
