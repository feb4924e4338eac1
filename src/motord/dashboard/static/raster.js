/**
 * Signals over time as pixels: each a band from its minima to its maxima, with an outline, drawn column by column.
 * A live window that moves on keeps the pixels it has, and only the columns that are new are drawn. Pure.
 */

/** Share of ink between the outlines. */
const SHADE = 0.3;
/** A column is looked at in so many parts: steep lines have smooth sides. */
const PARTS = 4;

/** @typedef {{low: Float32Array, high: Float32Array, rgb: number, dash: number[] | null}} Band `rgb` as 0xBBGGRR; `dash`: on, off in px */
/** @typedef {{first: number, count: number, dt_s: number, version: number}} Grid of buckets, see `Buckets` */

export class Raster {
  /** @param {number} width px @param {number} height px @param {number} line width of an outline, px */
  constructor(width, height, line) {
    this.width = width;
    this.height = height;
    /** Rows from the top, 0xAABBGGRR, not premultiplied: the bytes of an ImageData. */
    this.pixels = new Uint32Array(width * height);
    this._half = line / 2;
    this._cover = new Float32Array(height);
    this._top = this._bottom = 0; // rows of it that are not zero
    this._edge = new Float64Array(2);
    this._state = { span_s: NaN, min: NaN, max: NaN, version: -1, end: 0, buckets: 0 };
  }

  /**
   * Draw the bands in a window of time and values; columns are those of a grid from time 0 on.
   * @param {Grid} grid
   * @param {Band[]} bands the same ones, in the same arrays, as long as `grid.version` is the same
   * @param {number} to_s right edge
   * @param {number} span_s
   * @param {{min: number, max: number}} scale of values
   * @returns {number} how many columns were drawn
   */
  draw(grid, bands, to_s, span_s, { min, max }) {
    const { width, _state: before } = this;
    const step_s = span_s / width;
    const end = Math.round(to_s / step_s);
    const begin = end - width;
    const shift = end - before.end;
    const goesOn = span_s === before.span_s && min === before.min && max === before.max && grid.version === before.version;
    let from = begin;
    if (goesOn && shift >= 0 && shift < width) {
      // lines to the newest bucket of before change with it: they begin at the middle of the one before it
      const changed_s = (before.buckets - 1.5) * grid.dt_s;
      from = Math.max(begin, Math.min(before.end, Math.floor(changed_s / step_s - this._half)) - 1);
      this.pixels.copyWithin(0, shift); // what wraps to the next row is in columns that are drawn now
    }
    this._state = { span_s, min, max, version: grid.version, end, buckets: grid.first + grid.count };
    for (let row = 0; row < this.height; row++) this.pixels.fill(0, row * width + from - begin, (row + 1) * width);
    const perBucket = step_s / grid.dt_s;
    const perValue = this.height / (max - min);
    for (const band of bands) {
      for (let column = from; column < end; column++) {
        const at = column * perBucket - grid.first - 0.5; // in buckets, from the middle of the first one on
        this._column(band, column - begin, column, at, perBucket, max, perValue);
      }
    }
    return end - from;
  }

  /** @param {Band} band @param {number} x @param {number} column counted from time 0 @param {number} at place of its left edge, in buckets @param {number} perBucket @param {number} max @param {number} perValue */
  _column(band, x, column, at, perBucket, max, perValue) {
    this._top = this.height;
    this._bottom = 0;
    for (let k = 0; k < PARTS; k++) this._part(band, column, at + (k / PARTS) * perBucket, perBucket, max, perValue);
    for (let y = this._top; y < this._bottom; y++) {
      this._blend(y * this.width + x, band.rgb, this._cover[y]);
      this._cover[y] = 0;
    }
  }

  /** A part of a column: the outlines, as thick to the sides as up and down, and what is between them. @param {Band} band @param {number} column @param {number} at @param {number} perBucket @param {number} max @param {number} perValue */
  _part({ low, high, dash }, column, at, perBucket, max, perValue) {
    const { _edge: edge, _half: half } = this;
    const [from, to] = [at - half * perBucket, at + (1 / PARTS + half) * perBucket];
    if (!extent(high, from, to, edge)) return;
    const [top, topEnd] = [(max - edge[1]) * perValue - half, (max - edge[0]) * perValue + half];
    if (!extent(low, from, to, edge)) return;
    const [bottom, bottomEnd] = [(max - edge[1]) * perValue - half, (max - edge[0]) * perValue + half];
    if (dash !== null) this._dashed(column, top, bottomEnd, dash);
    else if (topEnd >= bottom) this._add(top, bottomEnd, 1);
    else {
      this._add(top, topEnd, 1);
      this._add(topEnd, bottom, SHADE);
      this._add(bottom, bottomEnd, 1);
    }
  }

  /** Dashes go along the columns; where a line is steep, down the rows: a step is never in a gap. @param {number} column @param {number} top @param {number} bottom @param {number[]} dash */
  _dashed(column, top, bottom, [on, off]) {
    const period = on + off;
    if (bottom - top <= on) {
      if (column % period < on) this._add(top, bottom, 1);
      return;
    }
    const first = Math.floor(top / period) * period;
    for (let y = first; y < bottom; y += period) this._add(Math.max(y, top), Math.min(y + on, bottom), 1);
  }

  /** Cover the rows from y to y, those at the ends by their share. @param {number} top @param {number} bottom @param {number} share of ink */
  _add(top, bottom, share) {
    const { _cover: cover } = this;
    const from = Math.max(0, top);
    const to = Math.min(this.height, bottom);
    if (!(from < to)) return;
    const [first, last] = [Math.floor(from), Math.ceil(to) - 1];
    const ink = share / PARTS;
    for (let y = first; y <= last; y++) cover[y] += ink;
    cover[first] -= ink * (from - first);
    cover[last] -= ink * (last + 1 - to);
    if (first < this._top) this._top = first;
    if (last >= this._bottom) this._bottom = last + 1;
  }

  /** @param {number} at @param {number} rgb @param {number} share of the pixel that is covered, 0 to 1 */
  _blend(at, rgb, share) {
    const alpha = Math.min(255, Math.round(255 * share));
    const under = this.pixels[at];
    if (alpha === 255 || under === 0) {
      this.pixels[at] = (alpha << 24) | rgb;
      return;
    }
    const kept = ((under >>> 24) * (255 - alpha)) / 255;
    const sum = alpha + kept;
    const blue = Math.round(((rgb >>> 16) * alpha + ((under >>> 16) & 255) * kept) / sum);
    const green = Math.round((((rgb >>> 8) & 255) * alpha + ((under >>> 8) & 255) * kept) / sum);
    const red = Math.round(((rgb & 255) * alpha + (under & 255) * kept) / sum);
    this.pixels[at] = (Math.round(sum) << 24) | (blue << 16) | (green << 8) | red;
  }
}

/**
 * The smallest and the largest value of the line through a row's values between two places, which count buckets from the
 * middle of the first one on. Next to a gap (NaN) a value holds for half a bucket.
 * @param {Float32Array} row
 * @param {number} from
 * @param {number} to
 * @param {Float64Array} out
 * @returns {boolean} whether there is a line
 */
function extent(row, from, to, out) {
  let min = Infinity;
  let max = -Infinity;
  const until = Math.min(Math.floor(to), row.length - 1);
  for (let i = Math.max(0, Math.ceil(from)); i <= until; i++) {
    if (row[i] < min) min = row[i];
    if (row[i] > max) max = row[i];
  }
  const left = between(row, from);
  const right = between(row, to);
  if (left < min) min = left;
  if (left > max) max = left;
  if (right < min) min = right;
  if (right > max) max = right;
  out[0] = min;
  out[1] = max;
  return min <= max;
}

/** @param {Float32Array} row @param {number} at */
function between(row, at) {
  const i = Math.floor(at);
  const share = at - i;
  const value = row[i] * (1 - share) + row[i + 1] * share;
  return value === value ? value : row[share < 0.5 ? i : i + 1];
}

/** The number of a colour as computed styles give it, `rgb(r, g, b)`. @param {string} text */
export function rgbOf(text) {
  const [red, green, blue] = text.match(/\d+/g)?.map(Number) ?? [0, 0, 0];
  return (blue << 16) | (green << 8) | red;
}
