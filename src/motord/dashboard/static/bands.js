/** How uPlot draws a signal of minima and maxima: a band that is never thinner than its outline. */

/**
 * A path builder for the row of maxima, which follows its row of minima in the data. The band is one
 * polygon from gap to gap, so that a bucket with a spike of one tick is as tall as the spike.
 * @param {any} u the uPlot
 * @param {number} series of the maxima
 */
export function bandPaths(u, series) {
  const path = new Path2D();
  const [time, low, high] = [u.data[0], u.data[series - 1], u.data[series]];
  const { left, top, width, height } = u.bbox;
  const [x, y] = [u.scales.x, u.scales[u.series[series].scale]];
  const banded = u.series[series].dash === undefined || u.series[series].dash.length === 0;
  const perTime = width / (x.max - x.min);
  const perValue = height / (y.max - y.min);
  const dt = time.length > 1 ? time[1] - time[0] : 0;
  const last = Math.min(time.length - 1, Math.ceil((x.max - time[0]) / dt) + 1);
  let i = Math.max(0, Math.floor((x.min - time[0]) / dt) - 1);
  while (i <= last) {
    while (i <= last && low[i] !== low[i]) i++; // NaN: no tick
    const from = i;
    while (i <= last && low[i] === low[i]) i++;
    if (i > from) polygon(from, i - 1);
  }
  return { stroke: path, fill: banded ? path : null, clip: null, band: null, gaps: null, flags: 0 };

  /** @param {number} from @param {number} to */
  function polygon(from, to) {
    const half = (perTime * dt) / 2;
    const first = left + (time[from] - x.min) * perTime;
    path.moveTo(first - half, top + (y.max - high[from]) * perValue);
    for (let k = from; k <= to; k++) {
      path.lineTo(left + (time[k] - x.min) * perTime, top + (y.max - high[k]) * perValue);
    }
    if (!banded) return; // dashes there and back would fill each other's gaps
    for (let k = to; k >= from; k--) {
      path.lineTo(left + (time[k] - x.min) * perTime, top + (y.max - low[k]) * perValue);
    }
    path.lineTo(first - half, top + (y.max - low[from]) * perValue);
  }
}

/** The row of minima draws nothing itself. */
export const noPaths = () => null;
