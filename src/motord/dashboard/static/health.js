/** Loop health: histograms of wake-up and work, missed ticks, link errors, ages, processes, recording. */

import { Chart, stepped } from "./chart.js";
import { byId, element, setAttribute, setText } from "./dom.js";
import { age, number, significant } from "./format.js";

const OLD_S = 0.5;
const LINES = [{ colour: "trace-1", width: 1.75, paths: stepped }, { colour: "trace-2", width: 1.75, dash: [5, 3], paths: stepped }];
const micro = (/** @type {number} */ us) => (us >= 1000 ? `${us / 1000} ms` : `${significant(us, 1)} \u00b5s`);
const thousands = (/** @type {number} */ count) => (count >= 1000 ? `${count / 1000}k` : String(count));

export class Health {
  /** @param {import("./state.js").Bench} bench */
  constructor(bench) {
    this._bench = bench;
    /** @type {any} */
    this._timing = null;
    this._counts = new Float32Array(0);
    this._open = false;
    /** @type {Map<string, any>} its value, by the name of a figure */
    this._rows = new Map();
    /** @type {Set<string>} the figures of the newest state */
    this._present = new Set();
    this._chart = new Chart(byId("timing-chart"), { log: true, label: micro }, { log: true, label: thousands }, LINES, () => this._histograms());
    bench.on("timing", (header, floats) => {
      this._timing = header;
      this._counts = floats;
      if (this._open) this._chart.redraw();
    });
    bench.on("state", () => this._open && this._show());
  }

  /** @param {boolean} open */
  setOpen(open) {
    this._open = open;
    if (open && this._bench.state) this._show();
    if (open) this._chart.redraw();
  }

  _histograms() {
    const edges = this._timing?.edges_us;
    if (!edges) return null;
    const bins = edges.length - 1;
    let [first, last, most] = [bins, 0, 1];
    for (let i = 0; i < bins; i++) {
      const high = Math.max(this._counts[i], this._counts[bins + i]);
      if (high > 0) [first, last] = [Math.min(first, i), i];
      if (high > most) most = high;
    }
    if (first === bins) [first, last] = [0, bins - 1];
    const [from, to] = [Math.max(0, first - 1), Math.min(bins, last + 2)];
    const places = edges.slice(from, to + 1);
    const row = (/** @type {number} */ k) => places.map((_, i) => Math.max(0.7, this._counts[k * bins + Math.min(from + i, to - 1)] ?? 0));
    return { x: [edges[from], edges[to]], y: [0.7, most * 1.5], data: [places, row(0), row(1)] };
  }

  _show() {
    const { state } = this._bench;
    const { loop, recording } = state;
    this._present.clear();
    const us = (/** @type {number | null} */ value) => (value === null ? "\u2013" : `${significant(value, 3)} \u00b5s`);
    this._figure("Loop", `${number(loop.rate_Hz, 0)} Hz, ${loop.ticks} ticks`);
    this._figure("Wake-up p50 / p99 / max", `${us(loop.wake_late_us_p50)} / ${us(loop.wake_late_us_p99)} / ${us(loop.wake_late_us_max)}`);
    this._figure("Work p99", us(loop.work_us_p99));
    this._figure("Missed ticks", String(loop.missed), loop.missed > 0 ? "warning" : "");
    this._figure("Lost by the supervisor", String(loop.lost_by_supervisor), loop.lost_by_supervisor > 0 ? "warning" : "");
    this._figure("Telemetry dropped", String(state.telemetry_dropped), state.telemetry_dropped > 0 ? "warning" : "");
    if (state.links) this._links(state.links);
    this._figure("Real time", state.realtime.granted ? "granted" : "not granted", state.realtime.granted ? "" : "warning");
    if (state.bridge_clock) this._figure("Bridge clock", `${number(state.bridge_clock.drift_ppm, 1)} ppm, jitter ${number(state.bridge_clock.jitter_us, 0)} \u00b5s`);
    for (const name of ["brake", "drive"]) this._device(name, state[name]);
    for (const channel of state.channels ?? []) this._channel(channel);
    for (const [name, process] of Object.entries(state.processes)) {
      this._figure(`Process ${name}`, `${process.running ? "runs" : `ended: ${process.exit || "not started"}`}, ${process.restarts} restarts`, process.running ? "" : "warning");
    }
    for (const [name, fault] of Object.entries(state.faults ?? {})) this._figure(`Fault in ${name}`, String(fault), "error");
    const why = recording.error || recording.obstacle;
    const bytes = recording.detail?.bytes;
    const file = recording.recording ? `${recording.path.split("/").pop()}${bytes ? `, ${number(bytes / 1e6, 1)} MB` : ""}` : "";
    this._figure("Recording", [file, why].filter(Boolean).join(": ") || "no", recording.error ? "error" : recording.obstacle ? "warning" : "");
    this._ages();
    this._removeOld();
  }

  /** @param {any} links */
  _links(links) {
    const text = links.bus_off ? "the CAN controller is off the bus" : `${links.errors}, ${links.errors_last_s} in the last second`;
    this._figure("Link errors", text, links.bus_off ? "error" : links.errors_last_s > 0 ? "warning" : "");
    if (links.bridge) this._figure("Bridge board", links.bridge, "error");
  }

  /** @param {string} name @param {any} device */
  _device(name, device) {
    if (!device || device.health === "none") return;
    const words = `${device.health}${device.age_s === null ? "" : `, ${age(device.age_s)} old`}${device.error ? `: ${device.error}` : ""}`;
    this._figure(name[0].toUpperCase() + name.slice(1), words, device.health === "ok" || device.health === "simulated" ? "" : "warning");
  }

  /** @param {{name: string, unit: string, value: number | null, status: string, age_s: number | null, error: string}} channel */
  _channel({ name, unit, value, status, age_s, error }) {
    const words = `${value === null ? "\u2013" : significant(value, 5)} ${unit}, ${status}${age_s === null ? "" : `, ${age(age_s)} old`}${error ? `: ${error}` : ""}`;
    const severity = status === "trip" || status === "broken" ? "error" : status === "ok" ? "" : "warning";
    this._figure(`Channel ${name}`, words, severity);
  }

  /** A row of the table; made once, and kept while the state has it. @param {string} name @param {string} text @param {string} [severity] */
  _figure(name, text, severity = "") {
    this._present.add(name);
    let value = this._rows.get(name);
    if (value === undefined) {
      value = element("dd");
      byId("health-figures").append(element("div", {}, element("dt", {}, name), value));
      this._rows.set(name, value);
    }
    setText(value, (severity === "warning" ? "\u26a0 " : severity === "error" ? "\u2716 " : "") + text);
    setAttribute(value, "class", severity || null);
  }

  /** What the state no longer has, a fault that is over, is no figure. */
  _removeOld() {
    for (const [name, value] of this._rows) {
      if (this._present.has(name)) continue;
      value.parentElement.remove();
      this._rows.delete(name);
    }
  }

  _ages() {
    for (const [name, age_s] of Object.entries(this._bench.state.ages ?? {})) {
      this._figure(`Age of ${name.replaceAll("_", " ")}`, age(age_s), age_s === null || age_s >= OLD_S ? "warning" : "");
    }
  }
}
