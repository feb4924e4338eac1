/** What is known of the bench, from the newest messages, and how old it is. */

import { decimals, niceStep } from "./format.js";

export const STALE_S = 0.5;

/** What each state of the drive means, and what to do next. @type {Record<string, {sign: string, meaning: string}>} */
export const STATES = {
  OFF: { sign: "\u25cb", meaning: "No current." },
  READY: { sign: "\u25d0", meaning: "No current yet; ready to be enabled." },
  ENABLED: { sign: "\u25cf", meaning: "The power stage conducts: the rotor may move." },
  TRIPPED: { sign: "\u2716", meaning: "An interlock took the current away." },
};

/** @typedef {"hello" | "state" | "plan" | "mesh" | "queue" | "event" | "events" | "connection" | "lease" | "timing" | "turns" | "link" | "age" | "error"} Kind */

/** Whether a plan is under way, by its state. @param {{state: string} | null | undefined} plan */
export const underWay = (plan) => ["running", "pausing", "paused", "ending"].includes(plan?.state ?? "");

export class Bench {
  constructor() {
    /** @type {any} */
    this.hello = null;
    /** @type {any} the state as the daemon published it */
    this.state = null;
    /** @type {any} */
    this.plan = null;
    /** @type {any} */
    this.mesh = null;
    /** @type {any} all of the queue: items and history; in short it is in the state */
    this.queue = null;
    /** @type {any} */
    this.lease = { held: false, holder: null, remaining_s: 0, why: "" };
    /** @type {any} */
    this.connection = { alive: false, age_s: null, tick_age_s: 0, message: "" };
    /** @type {{status: import("./socket.js").LinkStatus, message: string}} */
    this.link = { status: "connecting", message: "" };
    this.epoch_s = 0;
    /** @type {{value: number, label: string}[]} */
    this.torqueLimits = [];
    this._state_ms = -Infinity;
    /** @type {Map<string, ((data: any, floats: Float32Array) => void)[]>} */
    this._listeners = new Map();
  }

  /** @param {Kind} kind @param {(data: any, floats: Float32Array) => void} listener */
  on(kind, listener) {
    this._listeners.set(kind, [...(this._listeners.get(kind) ?? []), listener]);
  }

  /** Take a message; kinds that are not known are skipped. @param {any} header @param {Float32Array} floats */
  take(header, floats) {
    const data = DOCUMENTS.has(header.kind) ? header.data : header;
    if (header.kind === "hello") this._hello(header);
    else if (header.kind === "state") this._takeState(data);
    else if (header.kind === "plan") this.plan = data;
    else if (header.kind === "mesh") this.mesh = data;
    else if (header.kind === "queue") this.queue = data;
    else if (header.kind === "lease") this.lease = header;
    else if (header.kind === "connection") this._takeConnection(header);
    this.emit(header.kind, data, floats);
  }

  /** @param {string} kind @param {any} data @param {Float32Array} [floats] */
  emit(kind, data, floats = NONE) {
    for (const listener of this._listeners.get(kind) ?? []) listener(data, floats);
  }

  /** @param {import("./socket.js").LinkStatus} status @param {string} message */
  setLink(status, message) {
    this.link = { status, message };
    if (status !== "open") this.lease = { held: false, holder: this.lease.holder, remaining_s: 0, why: "" };
    this.emit("link", this.link);
  }

  /** @param {any} header */
  _hello(header) {
    this.hello = header;
    this.epoch_s = header.epoch_ns / 1e9;
    const limit = header.limits?.torque_Nm;
    const trip = header.limits?.trip_torque_Nm;
    this.torqueLimits = [
      ...(limit ? [{ value: limit, label: "limit" }, { value: -limit, label: "limit" }] : []),
      ...(trip ? [{ value: trip, label: "trips" }, { value: -trip, label: "trips" }] : []),
    ];
  }

  /** @param {any} state */
  _takeState(state) {
    this.state = state;
    this._state_ms = performance.now();
    this.plan = state.plan;
  }

  /** A state that the server keeps of a daemon that is gone is as old as that. @param {any} connection */
  _takeConnection(connection) {
    this.connection = connection;
    this._state_ms = Math.min(this._state_ms, performance.now() - 1000 * connection.age_s);
  }

  /** How old the newest state is, s. */
  get age_s() {
    return (performance.now() - this._state_ms) / 1000;
  }

  /** Whether what is shown is not what is. */
  get stale() {
    return this.link.status !== "open" || !this.connection.alive || this.age_s > STALE_S;
  }

  /** Whether the loop gives no ticks, or they do not arrive: what was drawn of them is not what is. */
  get ticksStale() {
    return this.stale || this.loopSilent || this.connection.tick_age_s > STALE_S;
  }

  /** Whether by the state the loop gives no ticks. */
  get loopSilent() {
    return this.state === null || this.state.tick === null || this.state.loop.age_s > STALE_S;
  }

  /** Whether the torque sensor measures a steady torque; a piezoelectric one does not. */
  get sensorPassesMean() {
    return !(this.state?.torque_sensor?.highpass_time_constant_s > 0);
  }

  /** The largest torque that may be set: by it goes how finely torques are set, written and drawn. */
  get torqueLimit_Nm() {
    return this.hello?.limits?.torque_Nm ?? 6;
  }

  /** Step of torques that are set. */
  get torqueStep_Nm() {
    return niceStep(this.torqueLimit_Nm / 200);
  }

  /** Decimals of a torque, Nm. */
  get torqueDigits() {
    return Math.max(2, decimals(this.torqueStep_Nm));
  }

  get viewer() {
    return this.hello?.role === "viewer";
  }

  /** Why this page cannot command now, "" if it can. */
  get commandObstacle() {
    if (this.link.status !== "open") return "No connection.";
    if (this.viewer) return "A viewer's page does not command.";
    if (!this.connection.alive) return "The daemon does not answer.";
    return "";
  }

  /** The same, with the lease. */
  get leaseObstacle() {
    return this.commandObstacle || (this.lease.held ? "" : "Take control first.");
  }

  /** Why nobody can enable the bench now, "" if one can. */
  get enableObstacle() {
    const { state, plan } = this;
    if (state === null) return "Not known yet.";
    if (underWay(plan)) return "A plan is under way.";
    if (state.state === "ENABLED") return "It is enabled.";
    if (state.state === "TRIPPED" || state.remedy) return "Reset it first.";
    const bars = state.trips.map((/** @type {any} */ trip) => trip.meaning); // OFF: no trip, but it would be one
    return bars.length ? `It cannot be enabled: ${bars.join("; ")}.` : "";
  }

  get now_s() {
    return this.state === null ? null : this.state.t_ns / 1e9 - this.epoch_s + Math.min(this.age_s, 60);
  }
}

const DOCUMENTS = new Set(["state", "plan", "event", "events", "mesh", "queue"]);
const NONE = new Float32Array(0);
