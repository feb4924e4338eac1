/** Stopping: what was asked, and what the daemon reported. "Stopped" is only ever the latter. */

import { byId, setAttribute, setText } from "./dom.js";

const UNCONFIRMED_S = 1.5;
const SHOWN_S = 6;

/** @typedef {"idle" | "stopping" | "stopped" | "unconfirmed" | "not sent"} StopStatus */

/** From the click to the report. Pure. */
export class StopTracker {
  constructor() {
    /** @type {StopStatus} */
    this.status = "idle";
    this.message = "";
    this._asked_s = 0;
    this._replied = false;
    this._reported = "";
    /** @type {number | null} when the report that is shown was first seen by `tick` */
    this._shown_s = null;
  }

  /** @param {number} now_s @param {boolean} sent */
  asked(now_s, sent) {
    this.status = sent ? "stopping" : "not sent";
    this.message = sent ? "Stopping\u2026" : "NOT SENT: no connection to the daemon. Use the emergency stop of the bench.";
    this._asked_s = now_s;
    this._replied = false;
    this._reported = "";
  }

  /** The daemon answered the request. */
  replied() {
    this._replied = true;
    this._settle();
  }

  /** The request was refused, or nobody answered. @param {string} why */
  failed(why) {
    if (this.status === "stopped") return;
    this.status = "not sent";
    this.message = `NOT STOPPED by this page: ${why}. Use the emergency stop of the bench.`;
  }

  /** The daemon published a state: after READY comes OFF, and both are said. @param {string} state */
  reported(state) {
    this._reported = state;
    if (this.status === "stopped" && state === "ENABLED") this.status = "idle";
    else if (this.status !== "idle" && this.status !== "not sent") this._settle();
  }

  _settle() {
    if (!this._replied || this._reported === "" || this._reported === "ENABLED") return;
    const message = `Stopped: the daemon reports ${this._reported}.`;
    if (this.status === "stopped" && this.message === message) return;
    this.status = "stopped";
    this.message = message;
    this._shown_s = null;
  }

  /** @param {number} now_s */
  tick(now_s) {
    if (this.status === "stopping" && now_s - this._asked_s > UNCONFIRMED_S) {
      this.status = "unconfirmed";
      this.message = "Stopping\u2026 the daemon has not confirmed it. Use the emergency stop of the bench.";
    } else if (this.status === "stopped") {
      this._shown_s ??= now_s;
      if (now_s - this._shown_s > SHOWN_S) this.status = "idle";
    }
  }
}

export class StopButton {
  /** @param {import("./state.js").Bench} bench @param {import("./socket.js").Socket} socket */
  constructor(bench, socket) {
    this._bench = bench;
    this._socket = socket;
    this._tracker = new StopTracker();
    this._button = byId("stop");
    this._button.addEventListener("click", () => this.stop());
    bench.on("state", (state) => {
      this._tracker.reported(state.state);
      this._show();
    });
    bench.on("hello", () => this._show());
  }

  /** Ask the daemon to stop; anybody but a viewer may, with and without the lease. */
  stop() {
    if (this._bench.viewer) {
      byId("stop-status").textContent = "A viewer's page cannot stop the bench.";
      return;
    }
    this._tracker.asked(performance.now() / 1000, this._socket.open);
    this._show();
    if (!this._socket.open) return;
    this._socket.call("stop").then(
      () => this._tracker.replied(),
      (error) => this._tracker.failed(error.message),
    ).then(() => this._show());
  }

  tick() {
    this._tracker.tick(performance.now() / 1000);
    this._show();
  }

  _show() {
    const { status, message } = this._tracker;
    setAttribute(this._button, "data-status", status);
    setAttribute(this._button, "aria-disabled", this._bench.viewer ? "true" : null);
    setText(byId("stop-label"), status === "stopping" || status === "unconfirmed" ? "Stopping\u2026" : "STOP");
    if (status === "idle" && this._bench.viewer) return;
    setText(byId("stop-status"), status === "idle" ? "" : message);
    setAttribute(byId("stop-status"), "data-status", status);
  }
}
