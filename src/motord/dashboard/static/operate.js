/** Operating by hand: lease, enable, reset, torque, speed, brake and drive, with the ramp. */

import { allow, byId, setAttribute, setHidden, setText } from "./dom.js";
import { number } from "./format.js";
import { underWay } from "./state.js";

export class Operate {
  /** @param {import("./state.js").Bench} bench @param {import("./socket.js").Socket} socket @param {import("./messages.js").Messages} messages */
  constructor(bench, socket, messages) {
    this._bench = bench;
    this._socket = socket;
    this._messages = messages;
    this._torqueInputs();
    byId("take").addEventListener("click", () => this._lease());
    for (const name of ["enable", "disable", "reset"]) byId(name).addEventListener("click", () => this._call(name));
    byId("zero").addEventListener("click", () => this._call("set", { torque_Nm: 0 }));
    this._form("torque-form", () => ({ torque_Nm: byId("torque").valueAsNumber }));
    this._form("speed-form", () => ({ speed_Hz: byId("speed").valueAsNumber }));
    this._form("drive-form", () => ({ drive_Hz: byId("drive").valueAsNumber }));
    byId("compensate").addEventListener("change", () => this._call("set", { compensate: byId("compensate").value }));
    byId("confirm-take").addEventListener("click", () => this._take(true));
    byId("cancel-take").addEventListener("click", () => this._askTakeOver(false));
    bench.on("hello", (hello) => this._hello(hello));
    for (const kind of /** @type {const} */ (["state", "lease", "link", "connection"])) bench.on(kind, () => this._show());
  }

  /**
   * Slider and number are one proposal, and neither sends: a thumb that scrolls a phone, or a wheel over the
   * slider, would else move a motor. "Set", or Enter in either, sends; zero, the safe way, is one press.
   */
  _torqueInputs() {
    const [slider, field] = [byId("torque-slider"), byId("torque")];
    slider.addEventListener("input", () => (field.value = slider.value));
    field.addEventListener("input", () => (slider.value = field.value));
    slider.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
      if (event.key === "Enter") byId("torque-form").requestSubmit();
    });
  }

  /** @param {any} hello */
  _hello(hello) {
    const { torqueLimit_Nm: limit, torqueStep_Nm: step } = this._bench;
    const slider = byId("torque-slider");
    const most = String(Number((Math.floor(limit / step + 1e-6) * step).toFixed(8))); // 0 is a whole number of steps from it
    for (const [id, end] of [["torque-slider", most], ["torque", String(limit)]]) {
      byId(id).min = `-${end}`;
      byId(id).max = end;
    }
    slider.step = String(step);
    setText(byId("torque-low"), `\u2212${most}`);
    setText(byId("torque-high"), `+${most} Nm`);
    const speed_Hz = 0.8 * (hello.limits?.trip_speed_rad_s ?? 0) / (2 * Math.PI);
    for (const id of ["speed", "drive"]) {
      byId(id).min = speed_Hz > 0 ? (-speed_Hz).toFixed(2) : "";
      byId(id).max = speed_Hz > 0 ? speed_Hz.toFixed(2) : "";
    }
    this._show();
  }

  /** @param {string} id @param {() => Record<string, number>} fields */
  _form(id, fields) {
    byId(id).addEventListener("submit", (/** @type {SubmitEvent} */ event) => {
      event.preventDefault();
      const given = fields();
      if (Object.values(given).every(Number.isFinite)) this._call("set", given);
    });
  }

  /** @param {string} name of an RPC @param {Record<string, any>} [args] */
  _call(name, args = {}) {
    setText(byId("operate-busy"), `${name}\u2026`);
    this._socket.call(name, args).catch(this._messages.failure(name)).finally(() => setText(byId("operate-busy"), ""));
  }

  _lease() {
    const { lease, state } = this._bench;
    const holder = state?.lease?.holder;
    if (lease.held) {
      this._socket.call("lease/release").catch(this._messages.failure("release"));
    } else if (holder && !holder.startsWith("plan ")) {
      setText(byId("take-over-text"), `${holder} is in command now and would lose it at once. The bench goes on as it is.`);
      this._askTakeOver(true);
    } else this._take(false);
  }

  /** @param {boolean} shown */
  _askTakeOver(shown) {
    setHidden(byId("take-over"), !shown);
    (shown ? byId("cancel-take") : byId("take")).focus();
  }

  /** @param {boolean} force */
  _take(force) {
    if (force) this._askTakeOver(false);
    this._socket.call("lease/acquire", { force }).then((reply) => {
      if (reply?.took_over_from) this._messages.say("info", `Command taken over from ${reply.took_over_from}.`);
    }, this._messages.failure("take control"));
  }

  _show() {
    const { state, lease } = this._bench;
    const why = this._bench.leaseObstacle;
    setText(byId("operate-why"), why);
    setHidden(byId("operate-why"), why === "");
    if (lease.held) setHidden(byId("take-over"), true);
    if (state === null) return;
    const plan = underWay(this._bench.plan) ? "A plan is under way." : "";
    const is = state.state;
    allow(byId("enable"), why || this._bench.enableObstacle);
    allow(byId("disable"), why || (is === "ENABLED" || is === "READY" ? "" : "It is not enabled."));
    allow(byId("reset"), why || (is === "TRIPPED" || state.fault ? "" : "Nothing has tripped."));
    const enabled = why || plan || (is === "ENABLED" ? "" : "Enable it first.");
    for (const id of ["torque-set", "zero", "torque-slider", "torque", "speed-set", "speed"]) allow(byId(id), enabled);
    allow(byId("compensate"), why || plan);
    this._drive(state, why || plan || (is === "READY" || is === "ENABLED" ? "" : "It is OFF."));
    this._ramp(state.setpoint);
    if (document.activeElement !== byId("compensate")) byId("compensate").value = state.setpoint.compensate;
  }

  /** @param {any} state @param {string} why */
  _drive(state, why) {
    setHidden(byId("drive-form"), state.drive?.health === "none");
    allow(byId("drive"), why);
    allow(byId("drive-set"), why);
    setText(byId("drive-now"), number(state.setpoint.drive_Hz, 2));
  }

  /** Set-point now, its target, and where both are within the limits. @param {any} setpoint */
  _ramp(setpoint) {
    const target = setpoint.torque_target_Nm ?? setpoint.torque_Nm;
    const { torqueLimit_Nm: limit, torqueStep_Nm: step, torqueDigits: digits } = this._bench;
    const ramping = Math.abs(target - setpoint.torque_Nm) > step / 100;
    setText(byId("setpoint-now"), number(setpoint.torque_Nm, digits));
    setText(byId("setpoint-target"), ramping ? `\u2192 ${number(target, digits)}` : "");
    setAttribute(byId("ramp"), "data-ramping", String(ramping));
    place(byId("ramp-now"), setpoint.torque_Nm / limit);
    place(byId("ramp-target"), target / limit);
    setText(byId("speed-now"), setpoint.speed_Hz === null ? "\u2013" : number(setpoint.speed_Hz, 2));
    setText(byId("brake-now"), `${number(100 * setpoint.brake, 0)} %`);
  }
}

/** @param {SVGElement} marker @param {number} share of the limit, -1 to 1 */
function place(marker, share) {
  setAttribute(marker, "transform", `translate(${(100 + 100 * Math.max(-1, Math.min(1, share))).toFixed(2)} 0)`);
}
