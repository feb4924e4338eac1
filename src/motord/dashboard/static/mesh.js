/** The mesh of a sweep: one cell for each torque and speed, RMS error as a colour and as a number. */

import { byId, element, setText } from "./dom.js";
import { niceStep, number, significant } from "./format.js";
import { underWay } from "./state.js";

/** Cividis, which people see alike with and without colour vision: dark is small. */
const STOPS = [[0, 34, 78], [53, 69, 109], [102, 105, 112], [148, 142, 119], [200, 184, 102], [254, 232, 56]];

/** @typedef {{torque_Nm: number, speed_Hz: number, state: string, rms_error_percent: number | null, quality: string, takes: number, induced?: Record<string, unknown>}} Point */

/** The colour of a share of the scale, and whether its text is to be light. Pure. @param {number} share 0 to 1 */
export function shade(share) {
  const at = Math.min(Math.max(share, 0), 1) * (STOPS.length - 1);
  const i = Math.min(Math.floor(at), STOPS.length - 2);
  const rgb = STOPS[i].map((from, k) => Math.round(from + (STOPS[i + 1][k] - from) * (at - i)));
  const linear = rgb.map((c) => (c / 255 <= 0.04045 ? c / 255 / 12.92 : ((c / 255 + 0.055) / 1.055) ** 2.4));
  const luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
  return { rgb: `rgb(${rgb.join(", ")})`, light: luminance < 0.179 };
}

/** Rows and columns of points, by the magnitudes of torque and speed or as they are; points with errors induced on
 * purpose show only where nothing else is. Pure. @param {Point[]} points @param {boolean} byMagnitude */
export function grid(points, byMagnitude) {
  const of = byMagnitude ? Math.abs : (/** @type {number} */ value) => value;
  const sorted = (/** @type {number[]} */ values) => [...new Set(values)].sort((a, b) => a - b);
  const speeds = sorted(points.map((point) => of(point.speed_Hz)));
  const torques = sorted(points.map((point) => of(point.torque_Nm))).reverse();
  /** @type {Map<string, Point>} */
  const at = new Map();
  for (const point of points) {
    const key = `${of(point.torque_Nm)} ${of(point.speed_Hz)}`;
    const there = at.get(key);
    if (induced(point) && there !== undefined && !induced(there)) continue;
    const first = there === undefined || (induced(there) && !induced(point));
    if (first || there.rms_error_percent === null || point.rms_error_percent !== null) at.set(key, point);
  }
  return { speeds, torques, at: (/** @type {number} */ torque, /** @type {number} */ speed) => at.get(`${torque} ${speed}`) };
}

/** Whether errors are induced at a point on purpose. @param {Point} point */
const induced = (point) => Object.keys(point.induced ?? {}).length > 0;

export class Mesh {
  /** @param {import("./state.js").Bench} bench */
  constructor(bench) {
    this._bench = bench;
    this._key = "";
    this._planless = false;
    bench.on("mesh", () => this._show());
    bench.on("plan", () => this._show());
    bench.on("state", ({ plan }) => { // one that was discarded is in no document
      if ((plan === null) === this._planless) return;
      this._planless = plan === null;
      this._show();
    });
  }

  _show() {
    const mesh = this._planless ? null : this._bench.mesh;
    const points = /** @type {Point[]} */ (mesh?.points ?? []);
    const taking = underWay(this._bench.plan); // the mesh of one that has ended says what it was at
    const key = JSON.stringify([mesh, taking]);
    if (key === this._key) return;
    this._key = key;
    byId("mesh-box").hidden = points.length === 0;
    byId("mesh-empty").hidden = points.length > 0;
    if (points.length === 0) return;
    const errors = points.map((point) => point.rms_error_percent ?? null).filter((error) => error !== null);
    const highest = Math.max(0.5, ...errors);
    const step = niceStep(highest / 5);
    const top = Math.ceil(highest / step) * step;
    byId("mesh").replaceChildren(...this._rows(points, mesh.by_magnitude === true, top, taking));
    setText(byId("scale-top"), `${significant(top, 2)} %`);
    const summary = errors.length ? `mean ${number(errors.reduce((a, b) => a + b, 0) / errors.length, 2)} %, worst ${number(Math.max(...errors), 2)} %` : "nothing measured yet";
    setText(byId("mesh-summary"), `${mesh.plan}: ${errors.length} of ${points.length} points, ${summary}`);
  }

  /** @param {Point[]} points @param {boolean} byMagnitude @param {number} top @param {boolean} taking */
  _rows(points, byMagnitude, top, taking) {
    const { speeds, torques, at } = grid(points, byMagnitude);
    const single = torques.length === 1 && torques[0] === 0;
    const head = element("tr", {}, element("td", {}), ...speeds.map((speed) => element("th", { scope: "col" }, number(speed, decimals(speeds)))));
    const rows = torques.map((torque) => element("tr", {},
      element("th", { scope: "row" }, single ? "\u2013" : number(torque, decimals(torques))),
      ...speeds.map((speed) => cell(at(torque, speed), top, taking))));
    return [element("thead", {}, head), element("tbody", {}, ...rows)];
  }
}

/** @param {number[]} values */
const decimals = (values) => Math.min(3, Math.max(...values.map((value) => (String(Math.round(value * 1000) / 1000).split(".")[1] ?? "").length)));

/** @param {Point | undefined} point @param {number} top @param {boolean} taking */
function cell(point, top, taking) {
  if (point === undefined) return element("td", { class: "none" });
  const error = point.rms_error_percent ?? null;
  const poor = point.state === "poor" || (point.quality && point.quality !== "ok");
  const now = taking && point.state === "taking";
  const text = error !== null ? number(error, error < 9.95 ? 2 : 1) : now ? "\u25b6" : "\u00b7";
  const about = `${point.torque_Nm} Nm, ${point.speed_Hz} Hz: ${error !== null ? `${number(error, 3)} %` : now ? "being taken" : taking ? "to come" : "not taken"}${poor ? `; ${point.quality}` : ""}${point.takes > 1 ? `; taken ${point.takes} times` : ""}`;
  const made = element("td", { class: `${now ? "now" : ""} ${poor ? "poor" : ""} ${error === null ? "open" : "done"}`, title: about }, text + (poor ? " !" : ""));
  if (error !== null) {
    const { rgb, light } = shade(error / top);
    made.style.backgroundColor = rgb;
    made.style.color = light ? "#fff" : "#000";
  }
  return made;
}
