/** A small chart by uPlot: lines, steps or bars over two axes; for what changes a few times a second. */

import uPlot from "./vendor/uPlot.esm.js";
import { InView } from "./dom.js";
import { decimals, number, STEPS } from "./format.js";
import { colour, onTheme } from "./theme.js";

const FONT = 'system-ui, "DejaVu Sans", sans-serif';

/** Values that hold up to the next place, and bars from 0. */
export const stepped = uPlot.paths.stepped({ align: 1 });
export const bars = uPlot.paths.bars({ size: [1, 9, 1.5], gap: 1 });

/** @typedef {{label?: (value: number) => string, ticks?: number[], log?: boolean}} Axis */
/** @typedef {{colour: string, width?: number, alpha?: number, dash?: number[], paths?: any, filled?: boolean}} Line */
/** @typedef {{x: [number, number], y: [number, number], data: ArrayLike<number | null>[]}} Shown ranges of the axes; places, and a row for each line */

export class Chart {
  /**
   * @param {HTMLElement} box @param {Axis} x @param {Axis} y @param {Line[]} lines
   * @param {() => Shown | null} shown what there is to draw @param {() => void} over draws over it, with `level` and `text`
   */
  constructor(box, x, y, lines, shown, over = () => {}) {
    this._box = box;
    this._shown = shown;
    /** @type {any} */
    this._uplot = null;
    this._waiting = false;
    this._options = {
      padding: [8, 20, 0, 0], legend: { show: false }, cursor: { show: false }, pxAlign: 0,
      scales: { x: scale(x), y: scale(y) },
      axes: [{ ...axis(x), size: 18, space: 60 }, { ...axis(y), scale: "y", size: 44, space: 26 }],
      series: [{}, ...lines.map(({ colour: name, filled, ...style }) => ({
        width: 1.25, points: { show: false }, ...style, stroke: () => colour(name), fill: filled ? () => colour(name) : undefined,
      }))],
      hooks: { draw: [over] },
    };
    this._inView = new InView(box, () => this.redraw());
    onTheme(() => this.redraw());
    new ResizeObserver(() => this.redraw()).observe(box);
  }

  /** Draw with the next frame, if it is to be seen. */
  redraw() {
    if (this._waiting || document.hidden || !this._inView.now) return;
    this._waiting = true;
    requestAnimationFrame(() => {
      this._waiting = false;
      const { clientWidth: width, clientHeight: height } = this._box;
      const shown = width > 0 && height > 0 ? this._shown() : null;
      if (shown !== null) this._draw(shown, width, height);
    });
  }

  /** @param {Shown} shown @param {number} width @param {number} height */
  _draw({ x, y, data }, width, height) {
    this._uplot ??= new uPlot({ ...this._options, width, height }, data, this._box);
    this._uplot.batch(() => {
      if (width !== this._uplot.width || height !== this._uplot.height) this._uplot.setSize({ width, height });
      this._uplot.setData(data, false);
      this._uplot.setScale("x", { min: x[0], max: x[1] });
      this._uplot.setScale("y", { min: y[0], max: y[1] });
    });
  }

  /** A horizontal line with its name. @param {number} value @param {string} words @param {{colour: string, dash: number[]}} style */
  level(value, words, { colour: name, dash }) {
    const { ctx, bbox, scales } = this._uplot;
    if (value < scales.y.min || value > scales.y.max) return;
    const y = this._uplot.valToPos(value, "y", true);
    const right = bbox.left + bbox.width;
    ctx.save();
    ctx.strokeStyle = colour(name);
    ctx.lineWidth = 1.25 * devicePixelRatio;
    ctx.setLineDash(dash.map((px) => px * devicePixelRatio));
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(right, y);
    ctx.stroke();
    ctx.restore();
    this._words(words, right - 4 * devicePixelRatio, y - devicePixelRatio, "right", name);
  }

  /** Words over a place. @param {string} words @param {number} x @param {number} y */
  text(words, x, y) {
    this._words(words, this._uplot.valToPos(x, "x", true), this._uplot.valToPos(y, "y", true) - devicePixelRatio, "center", "ink");
  }

  /** @param {string} words @param {number} x px @param {number} y px @param {CanvasTextAlign} align @param {string} name of their colour */
  _words(words, x, y, align, name) {
    const { ctx } = this._uplot;
    ctx.save();
    ctx.font = `${11 * devicePixelRatio}px ${FONT}`;
    ctx.textAlign = align;
    ctx.textBaseline = "bottom";
    ctx.lineWidth = 4 * devicePixelRatio;
    ctx.lineJoin = "round";
    ctx.strokeStyle = colour("panel");
    if (align === "right") ctx.strokeText(words, x, y);
    ctx.fillStyle = colour(name);
    ctx.fillText(words, x, y);
    ctx.restore();
  }
}

/** @param {Axis} axis */
const scale = ({ log }) => ({ time: false, auto: false, distr: log ? 3 : 1, range: (/** @type {any} */ _u, /** @type {number} */ min, /** @type {number} */ max) => [min, max] });

/** Powers of ten, so many that a small chart has room for them. @param {any} _u @param {number} _a @param {number} min @param {number} max */
function powers(_u, _a, min, max) {
  const all = [];
  for (let k = Math.ceil(Math.log10(min) - 1e-9); 10 ** k <= max * 1.0001; k++) all.push(10 ** k);
  return all.filter((_, i) => i % Math.ceil(all.length / 4) === 0);
}

/** @param {Axis} axis */
function axis({ label, ticks, log }) {
  return {
    stroke: () => colour("soft"), font: `11px ${FONT}`, grid: { stroke: () => colour("grid"), width: 1 }, ticks: { show: false }, gap: 4, filter: (/** @type {any} */ _u, /** @type {number[]} */ splits) => splits,
    ...(ticks ? { splits: () => ticks } : log ? { splits: powers } : { incrs: STEPS }),
    values: (/** @type {any} */ _u, /** @type {(number | null)[]} */ at, /** @type {number} */ _a, /** @type {number} */ _s, /** @type {number} */ step) =>
      at.map((value) => (value === null ? "" : label ? label(value) : number(value, decimals(step)))),
  };
}
