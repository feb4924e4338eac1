/** A small chart on a canvas: two axes, lines, bars; for what changes a few times a second. */

import { InView } from "./dom.js";
import { niceStep, number } from "./format.js";
import { colour, onTheme } from "./theme.js";

const FONT = 'px system-ui, "DejaVu Sans", sans-serif';
const LEFT = 44;
const BOTTOM = 18;
const TOP = 8;
const RIGHT = 8;

/** @typedef {{from: number, to: number, label?: (value: number) => string, ticks?: number[], log?: boolean}} Axis */

export class Chart {
  /** @param {HTMLCanvasElement} canvas @param {() => void} draw draws all of it, with `begin` first */
  constructor(canvas, draw) {
    this.canvas = canvas;
    this._draw = draw;
    this._context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    this._waiting = false;
    this._inView = new InView(canvas, () => this.redraw());
    onTheme(() => this.redraw());
    new ResizeObserver(() => this.redraw()).observe(canvas);
  }

  /** Draw with the next frame, if it is to be seen. */
  redraw() {
    if (this._waiting || document.hidden || !this._inView.now) return;
    this._waiting = true;
    requestAnimationFrame(() => {
      this._waiting = false;
      if (this.canvas.clientWidth > 0) this._draw();
    });
  }

  /** Clear, and draw the axes. @param {Axis} x @param {Axis} y */
  begin(x, y) {
    const { canvas, _context: context } = this;
    const scale = devicePixelRatio;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(width * scale)) canvas.width = Math.round(width * scale);
    if (canvas.height !== Math.round(height * scale)) canvas.height = Math.round(height * scale);
    context.setTransform(scale, 0, 0, scale, 0, 0);
    context.clearRect(0, 0, width, height);
    context.font = `11${FONT}`;
    this._x = x;
    this._y = y;
    this.left = LEFT;
    this.right = width - RIGHT;
    this.top = TOP;
    this.bottom = height - BOTTOM;
    this._grid();
  }

  _grid() {
    const { _context: context, _x: x, _y: y } = this;
    context.lineWidth = 1;
    context.strokeStyle = colour("grid");
    context.fillStyle = colour("soft");
    context.textAlign = "center";
    context.textBaseline = "top";
    for (const value of ticks(x, (this.right - this.left) / 60)) {
      const at = Math.round(this.x(value)) + 0.5;
      this._line(at, this.top, at, this.bottom);
      const text = label(x, value);
      const half = context.measureText(text).width / 2;
      context.fillText(text, Math.min(at, this.right + RIGHT - half), this.bottom + 4);
    }
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (const value of ticks(y, (this.bottom - this.top) / 26)) {
      const at = Math.round(this.y(value)) + 0.5;
      this._line(this.left, at, this.right, at);
      context.fillText(label(y, value), this.left - 5, at);
    }
  }

  /** @param {number} value */
  x(value) {
    return this.left + (this.right - this.left) * share(/** @type {Axis} */ (this._x), value);
  }

  /** @param {number} value */
  y(value) {
    return this.bottom - (this.bottom - this.top) * share(/** @type {Axis} */ (this._y), value);
  }

  /** @param {number} x0 @param {number} y0 @param {number} x1 @param {number} y1 */
  _line(x0, y0, x1, y1) {
    this._context.beginPath();
    this._context.moveTo(x0, y0);
    this._context.lineTo(x1, y1);
    this._context.stroke();
  }

  /**
   * @param {number} count
   * @param {(i: number) => number} x
   * @param {(i: number) => number} y
   * @param {{colour: string, width?: number, alpha?: number, dash?: number[]}} style
   */
  line(count, x, y, style) {
    const { _context: context } = this;
    this._style(style);
    context.beginPath();
    for (let i = 0; i < count; i++) context.lineTo(this.x(x(i)), this.y(y(i)));
    context.stroke();
    this._plain();
  }

  /** A horizontal line with its name. @param {number} value @param {string} text @param {{colour: string, dash?: number[]}} style */
  level(value, text, style) {
    const { _context: context } = this;
    const { from, to } = /** @type {Axis} */ (this._y);
    if (value < from || value > to) return;
    this._style(style);
    this._line(this.left, this.y(value), this.right, this.y(value));
    this._plain();
    context.textAlign = "right";
    context.textBaseline = "bottom";
    context.lineWidth = 4;
    context.lineJoin = "round";
    context.strokeStyle = colour("panel");
    context.strokeText(text, this.right - 4, this.y(value) - 1);
    context.fillStyle = colour(style.colour);
    context.fillText(text, this.right - 4, this.y(value) - 1);
    this._plain();
  }

  /** A bar from the bottom. @param {number} x @param {number} width px @param {number} y @param {string} name of its colour */
  bar(x, width, y, name) {
    const at = this.y(y);
    this._context.fillStyle = colour(name);
    this._context.fillRect(this.x(x) - width / 2, at, width, this.bottom - at);
  }

  /** @param {string} text @param {number} x px of its middle @param {number} y px @param {string} name of its colour */
  text(text, x, y, name) {
    const { _context: context } = this;
    context.fillStyle = colour(name);
    context.textAlign = "center";
    context.textBaseline = "bottom";
    context.fillText(text, x, y);
  }

  /** @param {{colour: string, width?: number, alpha?: number, dash?: number[]}} style */
  _style({ colour: name, width = 1.25, alpha = 1, dash = [] }) {
    const { _context: context } = this;
    context.strokeStyle = colour(name);
    context.lineWidth = width;
    context.globalAlpha = alpha;
    context.setLineDash(dash);
  }

  _plain() {
    this._context.globalAlpha = 1;
    this._context.setLineDash([]);
    this._context.lineWidth = 1;
  }
}

/** @param {Axis} axis @param {number} value */
function share({ from, to, log }, value) {
  if (!log) return (value - from) / (to - from);
  return Math.log(Math.max(value, from) / from) / Math.log(to / from);
}

/** @param {Axis} axis @param {number} most */
function ticks({ from, to, log, ticks: given }, most) {
  if (given) return given;
  const found = [];
  if (log) {
    const decades = Math.max(1, Math.ceil(Math.log10(to / from) / Math.max(most, 1)));
    for (let k = Math.ceil(Math.log10(from) - 1e-9); 10 ** k <= to * 1.0001; k += decades) found.push(10 ** k);
    return found;
  }
  const step = niceStep((to - from) / Math.max(most, 1));
  for (let k = Math.ceil(from / step - 1e-6); k * step <= to + step * 1e-6; k++) found.push(k * step);
  return found;
}

/** @param {Axis} axis @param {number} value */
function label(axis, value) {
  if (axis.label) return axis.label(value);
  const width = axis.to - axis.from;
  return number(value, Math.max(0, Math.min(4, Math.ceil(1 - Math.log10(width)))));
}
