/** The plan under way: progress, and pause, resume, abort, discard. */

import { allow, byId, setAttribute, setHidden, setText } from "./dom.js";
import { duration, number } from "./format.js";
import { PlanPrecision } from "./precision.js";
import { stateText } from "./queue_items.js";
import { underWay } from "./state.js";

export class PlanProgress {
  /** @param {import("./state.js").Bench} bench @param {import("./socket.js").Socket} socket @param {import("./messages.js").Messages} messages */
  constructor(bench, socket, messages) {
    this._bench = bench;
    this._precision = new PlanPrecision(byId("plan-precision"));
    for (const name of ["pause", "resume", "abort", "discard"]) {
      byId(`plan-${name}`).addEventListener("click", () => socket.call(`plan/${name}`).catch(messages.failure(`plan ${name}`)));
    }
    for (const kind of /** @type {const} */ (["plan", "state", "lease", "link", "connection"])) bench.on(kind, () => this._show());
  }

  get active() {
    return underWay(this._bench.plan);
  }

  _show() {
    const plan = this._bench.plan;
    setHidden(byId("plan-none"), plan !== null || this._bench.state === null);
    setHidden(byId("plan-progress"), plan === null);
    if (plan === null) return;
    setAttribute(byId("plan-state"), "data-state", plan.state);
    setText(byId("plan-state"), stateText(plan.state));
    setText(byId("plan-name"), plan.plan + (plan.detached ? " (detached)" : ""));
    byId("plan-bar").value = plan.state === "done" ? 1 : plan.fraction;
    setText(byId("plan-count"), `${plan.points_done} of ${plan.points} points \u00b7 ${number(100 * plan.fraction, 0)} %`);
    const most = Object.keys(plan.targets ?? {}).length ? "at most " : "";
    setText(byId("plan-time"), `${duration(plan.elapsed_s)} elapsed${this.active ? ` \u00b7 ${most}${duration(plan.eta_s)} to go` : ""}`);
    this._precision.show(plan);
    setText(byId("plan-step"), plan.message || plan.step);
    setText(byId("plan-recording"), plan.recording ? plan.recording.split("/").pop() : "");
    setAttribute(byId("plan-recording"), "title", plan.recording || null);
    this._buttons(plan.state);
  }

  /** @param {string} state */
  _buttons(state) {
    const why = this._bench.leaseObstacle;
    const resumable = state === "paused" || ["interrupted", "aborted", "failed"].includes(state);
    setHidden(byId("plan-pause"), !["running", "pausing"].includes(state));
    setHidden(byId("plan-resume"), !resumable);
    setHidden(byId("plan-abort"), !this.active);
    setHidden(byId("plan-discard"), state !== "interrupted");
    for (const name of ["pause", "resume", "abort", "discard"]) allow(byId(`plan-${name}`), why);
    allow(byId("plan-pause"), why || (state === "pausing" ? "It is pausing." : ""));
  }
}
