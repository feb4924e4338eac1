/** The calibration in force and earlier ones: gains and offsets with intervals, cogging torque, what it brought. */

import { byId, element, setText } from "./dom.js";
import { commonDigits, number, plusMinus, significant } from "./format.js";
import { intervalPlot, turnCurve } from "./intervals.js";

const PHASES = ["a", "b", "c"];
const ORDERS_SHOWN = 6;
const AGAIN_MS = 1000;
const SEVERITIES = ["serious", "warning", "note"];

export class CalibrationPanel {
  /** @param {import("./state.js").Bench} bench @param {import("./socket.js").Socket} socket @param {import("./messages.js").Messages} messages */
  constructor(bench, socket, messages) {
    this._bench = bench;
    this._socket = socket;
    this._messages = messages;
    /** @type {string | null} of the calibration in force */
    this._id = null;
    this._open = false;
    this._none = byId("calibration-empty").textContent;
    byId("calibration-choice").addEventListener("change", () => this._show(byId("calibration-choice").value));
    bench.on("hello", () => {
      this._id = null;
    });
    bench.on("state", (state) => this._state(state));
  }

  /** @param {boolean} open whether the tab is to be seen */
  setOpen(open) {
    this._open = open;
    if (this._bench.state) this._state(this._bench.state);
  }

  /** @param {any} state */
  _state(state) {
    const id = state.calibration?.id ?? "";
    if (!this._open || id === this._id) return;
    this._id = id;
    this._load(id);
  }

  /** @param {string} inForce */
  async _load(inForce) {
    try {
      const { calibrations } = await this._socket.call("calibration/list");
      const select = byId("calibration-choice");
      select.replaceChildren(...calibrations.map((/** @type {any} */ one) =>
        element("option", { value: one.id, selected: one.id === inForce }, `${minute(one.created)} ${one.method} ${one.id.slice(0, 8)}${one.in_force ? " (in force)" : ""}`)));
      const any = calibrations.length > 0;
      setText(byId("calibration-empty"), this._none);
      byId("calibration-empty").hidden = any;
      byId("calibration-box").hidden = !any;
      if (any) await this._show(inForce || calibrations[0].id);
    } catch (error) {
      setTimeout(() => { this._id = null; }, AGAIN_MS); // and the next state asks again
      if (/** @type {any} */ (error).code === "disconnected") return;
      setText(byId("calibration-empty"), `Not known: ${/** @type {Error} */ (error).message}`);
      byId("calibration-empty").hidden = false;
    }
  }

  /** @param {string} id */
  async _show(id) {
    if (!id) return;
    try {
      const reply = await this._socket.call("calibration/show", { id });
      if (byId("calibration-choice").value === id) byId("calibration-content").replaceChildren(...content(reply));
    } catch (error) {
      this._messages.failure("calibration")(/** @type {Error} */ (error));
    }
  }
}

/** When a calibration was made, to the minute. @param {string} created in ISO 8601, of any time zone */
const minute = (created) => `${new Date(created).toISOString().slice(0, 16).replace("T", " ")} UTC`;

/** @param {string} text */
const sentence = (text) => text && `${text[0].toUpperCase()}${text.slice(1)}.`;

/**
 * Where the data depart from the model, the serious ones first.
 * @param {{name: string, value: number, limit: number, unit: string, severity: string, meaning: string, action: string}[]} found
 */
function findings(found) {
  if (!found.length) return null;
  const bySeverity = [...found].sort((a, b) => SEVERITIES.indexOf(a.severity) - SEVERITIES.indexOf(b.severity));
  return element("ul", { class: "findings", "aria-label": "Where the data depart from the model" }, ...bySeverity.map((one) => element("li", { class: one.severity },
    element("strong", {}, `${one.severity === "serious" ? "Serious" : one.severity === "warning" ? "Warning" : "Note"}: ${one.name}`),
    ` ${significant(one.value)} ${one.unit} (limit ${significant(one.limit)})`,
    element("span", {}, `${sentence(one.meaning)} ${sentence(one.action)}`))));
}

/** @param {number} value @param {number} [half] of its 95 % interval, if that is known */
const withInterval = (value, half) => (half === undefined ? `${number(value, 2)} %, interval not known` : `${plusMinus(value, half)} %`);

/** @param {any} found the reply of `calibration/show` */
function content(found) {
  const estimates = (/** @type {number[]} */ values, /** @type {number[][]} */ intervals) =>
    values.map((value, i) => ({ name: PHASES[i], value, low: intervals[i][0], high: intervals[i][1] }));
  const rms = found.rms_error_percent ?? {};
  const gained = ["before", "after"].filter((when) => rms[when]).map((when) => {
    const { mean, max, mean_half_width, max_half_width } = rms[when];
    return `${when} ${withInterval(mean, mean_half_width)} (worst ${withInterval(max, max_half_width)})`;
  }).join(", ");
  return [
    element("p", { class: "about" }, `${found.in_force ? "In force. " : "Earlier, not in force. "}${found.method}, ${found.runs?.length ?? 0} recording${found.runs?.length === 1 ? "" : "s"}${found.learned ? ", with learned corrections" : ""}`),
    findings(found.findings ?? []),
    element("h4", {}, "\u03b1, gain by phase, 95 %"), intervalPlot(estimates(found.alpha, found.alpha_95), 1, 4, ""),
    element("h4", {}, "\u03b2, offset by phase, 95 %"), intervalPlot(estimates(found.beta_A, found.beta_95_A), 0, 3, "A"),
    element("h4", {}, "\u03c4 cog over a turn, Nm"), turnCurve(found.tau_cog_Nm ?? [], "Nm"),
    orders(found.tau_cog_harmonics ?? [], found.tau_cog_half_widths_Nm ?? []),
    gained ? element("p", { class: "about" }, `RMS error: ${gained}`) : null,
    found.observable?.length ? element("ul", { class: "hint" }, ...found.observable.map((/** @type {string} */ text) => element("li", {}, text))) : null,
  ].filter((one) => one !== null);
}

/** @param {{order: number, amplitude_Nm: number}[]} harmonics @param {(number | null)[]} halfWidths_Nm */
function orders(harmonics, halfWidths_Nm) {
  const largest = harmonics.map((one, i) => ({ ...one, half_Nm: halfWidths_Nm[i] })).sort((a, b) => Math.abs(b.amplitude_Nm) - Math.abs(a.amplitude_Nm)).slice(0, ORDERS_SHOWN);
  const head = element("tr", {}, ...["order", "amplitude, mNm", "\u00b1 95 %"].map((text) => element("th", { scope: "col" }, text)));
  const digits = commonDigits(largest.map((one) => one.half_Nm && 1000 * one.half_Nm), 1);
  const rows = largest.map((one) => element("tr", {}, element("td", {}, String(one.order)),
    element("td", {}, number(1000 * Math.abs(one.amplitude_Nm), digits)), element("td", {}, one.half_Nm === null ? "?" : number(1000 * one.half_Nm, digits))));
  return element("table", { class: "figures" }, element("thead", {}, head), element("tbody", {}, ...rows));
}
