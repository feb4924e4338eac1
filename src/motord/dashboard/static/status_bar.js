/** The head of the page: state, lease, trips and connection, in words. */

import { allow, byId, element, setAttribute, setHidden, setText } from "./dom.js";
import { age, clock, duration, quantityText, significant } from "./format.js";
import { STATES } from "./state.js";

/** After so long what is known of why the daemon is silent has a line of its own; a hiccup moves nothing. */
const GONE_S = 2;

/** A line less is cut off; fonts that are taller than their line overflow by less. */
const HALF_A_LINE_PX = 7;

export class StatusBar {
  /** @param {import("./state.js").Bench} bench @param {import("./messages.js").Messages} messages */
  constructor(bench, messages) {
    this._bench = bench;
    this._messages = messages;
    this._uptime_s = 0;
    this._lostAt_ms = 0;
    this._wasOpen = false;
    this._held = false;
    this._alive = true;
    this._gone = false; // and it was said so
    this._silent_ms = performance.now();
    this._trip = "";
    this._ticksStale = false;
    bench.on("hello", (hello) => this._hello(hello));
    bench.on("state", (state) => this._state(state));
    bench.on("lease", () => this._lease());
    bench.on("link", () => this._link());
    bench.on("connection", () => this._connection());
    // narrow, the head scrolls away but for state and stop, whatever is above them
    const header = byId("state").parentElement;
    new ResizeObserver(() => {
      header.style.setProperty("--above", String(byId("state").offsetTop - 6));
      this._showAll();
    }).observe(header);
    const changes = { subtree: true, childList: true, characterData: true, attributeFilter: ["hidden"] };
    new MutationObserver(() => this._alerts()).observe(byId("alerts"), changes);
  }

  /** Narrow, the alerts are below the controls or scrolled away: their beginning stays at the head. */
  _alerts() {
    const boxes = [...byId("alerts").querySelectorAll("[role=alert]:not([hidden], :empty)")];
    setText(byId("alert-line"), boxes.map((box) => box.innerText.replace(/\s+/g, " ")).join(" \u00b7 "));
    setHidden(byId("alert-line"), boxes.length === 0);
  }

  /** @param {any} hello */
  _hello(hello) {
    setText(byId("bench-name"), hello.bench);
    document.title = `${hello.bench} \u00b7 motord`;
    setHidden(byId("viewer-note"), hello.role !== "viewer");
    document.body.dataset.role = hello.role;
  }

  /** @param {any} state */
  _state(state) {
    setAttribute(byId("state"), "data-state", state.state);
    setText(byId("state-sign"), STATES[state.state]?.sign ?? "?");
    setText(byId("state-name"), state.state);
    this._explain(state);
    setText(byId("motor"), state.motor + (state.simulated ? " \u00b7 simulated" : ""));
    setAttribute(byId("identity"), "title", `${state.bench}: ${byId("motor").textContent}`);
    this._trips(state);
    const wrong = troubles(state).join("; ");
    setHidden(byId("trouble"), wrong === "");
    setText(byId("trouble"), wrong);
    if (state.uptime_s < this._uptime_s) {
      this._messages.say("warning", `The daemon was restarted at ${clock(state.t_ns / 1e9 - state.uptime_s)}. It begins OFF; nothing was commanded.`);
    }
    this._uptime_s = state.uptime_s;
    this._lease();
  }

  /** What the state means and what to do: nothing of an old one. @param {any} state */
  _explain(state) {
    const trouble = [state.fault, state.remedy].filter(Boolean).join("; ");
    const meaning = trouble || this._meaning(state, STATES[state.state]?.meaning ?? "");
    if (byId("state-meaning").textContent === meaning) return;
    setText(byId("state-meaning"), meaning);
    this._showAll();
  }

  /** What the head cuts off, as it keeps its height, is whole among the alerts; a trip is there anyway. */
  _showAll() {
    const meaning = byId("state-meaning");
    const { state } = this._bench;
    const tripAlone = state?.state === "TRIPPED" && !state.fault;
    const cut = meaning.scrollHeight > meaning.clientHeight + HALF_A_LINE_PX && !tripAlone;
    setHidden(byId("state-all"), !cut);
    setText(byId("state-all"), cut ? meaning.textContent : "");
  }

  /** @param {any} state @param {string} meaning */
  _meaning(state, meaning) {
    const { enableObstacle, lease, stale } = this._bench;
    if (state.state === "TRIPPED") return state.first_trip ? tripText(this._bench, state.first_trip) : meaning;
    if (state.state === "ENABLED") return meaning;
    if (enableObstacle) return `${meaning} ${enableObstacle}`;
    return lease.held && !stale ? `${meaning} You may enable it.` : meaning;
  }

  /** @param {any} state */
  _trips(state) {
    const box = byId("trip");
    const { trip } = state;
    const key = state.state === "TRIPPED" ? JSON.stringify([trip, state.trips]) : "";
    if (key === this._trip) return;
    this._trip = key;
    setHidden(box, key === "");
    if (key === "") return box.replaceChildren();
    const causes = (trip?.causes ?? state.trips.map((/** @type {any} */ t) => t.name)).map(
      (/** @type {string} */ name) => element("li", {}, element("b", {}, name), ` ${tripText(this._bench, name, state)}`));
    const values = Object.entries(trip?.values ?? {}).map(([what, { value, limit }]) =>
      element("li", {}, quantityText(what, significant(value), significant(limit))));
    const action = trip?.action ?? this._bench.hello?.trips?.[state.first_trip]?.action ?? "find the cause";
    box.replaceChildren(
      element("strong", {}, `\u2716 Tripped${trip ? ` at ${clock(trip.t_ns / 1e9)}` : ""}`),
      element("ul", {}, ...causes, ...values),
      element("p", {}, element("b", {}, "What to do: "), `${action}; then Reset.`),
      ...(trip?.blackbox ? [element("p", { class: "path" }, `Black box: ${trip.blackbox}`)] : []),
    );
  }

  _lease() {
    const { lease, state } = this._bench;
    const holder = state?.lease?.holder ?? null;
    setAttribute(byId("lease"), "data-held", String(lease.held));
    setText(byId("lease-text"), lease.held ? "You are in command" : holder ? `${holder} is in command` : state ? "Nobody is in command" : "Not known who is in command");
    const lost = lease.why ? `Lost: ${lease.why}` : "";
    setText(byId("lease-why"), lease.held ? `Ends with this page, within ${age(state?.lease?.duration_s)}.` : lost);
    if (lost !== "" && this._held) this._messages.say("warning", `This page is no longer in command. ${lost}`);
    this._held = lease.held;
    const take = byId("take");
    setText(take, lease.held ? "Release" : holder && !holder.startsWith("plan ") ? "Take over\u2026" : "Take control");
    allow(take, this._bench.commandObstacle);
  }

  _link() {
    const { status, message } = this._bench.link;
    if (status === "open") {
      if (this._wasOpen) {
        const away_s = (performance.now() - this._lostAt_ms) / 1000;
        this._messages.say("info", `Connected again after ${duration(away_s)}. A lease held before is given up; nothing was commanded.`);
      }
      this._wasOpen = true;
    } else if (status === "waiting" && this._lostAt_ms === 0) this._lostAt_ms = performance.now();
    if (status === "open") this._lostAt_ms = 0;
    setHidden(byId("refused"), status !== "refused");
    if (status === "refused") setText(byId("refused-text"), message);
    this.tick();
    this._lease();
  }

  _connection() {
    const { alive, age_s } = this._bench.connection;
    if (this._alive && !alive) this._silent_ms = performance.now() - 1000 * age_s;
    if (alive && this._gone) this._messages.say("info", `The daemon publishes again, after ${duration((performance.now() - this._silent_ms) / 1000)}.`);
    if (alive) this._gone = false;
    this._alive = alive;
    this.tick();
    this._lease();
  }

  /** Ten times a second: what is stale is grey within half a second, and says so. */
  tick() {
    const { link, connection, stale, state, loopSilent, ticksStale, age_s } = this._bench;
    if (state !== null) this._explain(state);
    setAttribute(document.body, "data-stale", stale ? "true" : null);
    setAttribute(document.body, "data-ticks-stale", ticksStale ? "true" : null);
    const missing = loopSilent ? "no ticks come from the loop" : "no ticks arrive from the daemon";
    setText(byId("no-ticks"), ticksStale && !stale ? `${missing}; the last ones are shown` : "");
    if (ticksStale !== this._ticksStale) this._bench.emit("age", null);
    this._ticksStale = ticksStale;
    const gone = link.status === "open" && !connection.alive && connection.message !== "" && age_s > GONE_S;
    setHidden(byId("gone"), !gone);
    this._gone ||= gone;
    setText(byId("gone"), gone ? connection.message : "");
    const text =
      link.status === "refused" ? "not let in"
      : link.status !== "open" ? `no connection${link.message ? `: ${link.message}` : ""}; trying again`
      : !connection.alive ? "the daemon publishes nothing"
      : stale ? "stale" : "live";
    setText(byId("link-text"), text);
    setText(byId("link-age"), stale && Number.isFinite(age_s) ? `last state ${age(age_s)} ago; ` : "");
    setAttribute(byId("link"), "data-stale", String(stale));
  }
}

/** What is wrong with recording, processes and parts of the daemon, whichever tab is open; the loop's end is in the state. Pure. @param {any} state @returns {string[]} */
export function troubles(state) {
  const ended = Object.entries(state.processes).filter(([name, process]) => !process.running && !(name === "loop" && state.fault));
  return [
    ...(state.recording.error ? [`Recording: ${state.recording.error}`] : []),
    ...ended.map(([name, process]) => `The process ${name} does not run: ${process.exit || "not started"}`),
    ...Object.entries(state.faults ?? {}).map(([name, fault]) => `Fault in ${name}: ${fault}`),
  ];
}

/** @param {import("./state.js").Bench} bench @param {string} name @param {any} [state] */
function tripText(bench, name, state = bench.state) {
  const known = state?.trips?.find((/** @type {any} */ trip) => trip.name === name);
  return known?.meaning ?? bench.hello?.trips?.[name]?.meaning ?? name;
}
