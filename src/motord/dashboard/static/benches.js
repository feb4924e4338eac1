/** The page of all benches: a card for each, as the server last described it. It commands nothing. */

import { ageText, motionText, old, planText, queueText, recorderText, summary, troubles } from "./bench_texts.js";
import { byId, element, setAttribute, setHidden, setText } from "./dom.js";
import { takeToken } from "./session.js";
import { Socket } from "./socket.js";
import { STATES } from "./state.js";
import { startTheme } from "./theme.js";

/** @typedef {import("./bench_texts.js").BenchEntry} BenchEntry */

const TICK_MS = 250;
const STALE_S = 2;
const LINES = /** @type {const} */ (["plan", "queue", "motion", "recorder", "command"]);
const WORDS = { plan: "plan", queue: "queue", motion: "torque", recorder: "recorder", command: "its page" };

/** A bench's card; text changes in place, so that what is selected stays so. */
class Card {
  constructor() {
    this.name = element("h2");
    this.age = element("span", { class: "small soft" });
    this.state = element("span", { class: "state" });
    this.who = element("span", { class: "small soft" });
    this.why = element("div", { class: "why" });
    this.bar = element("progress", { max: "1", value: "0", hidden: true });
    /** @type {Record<string, any>} */
    this.lines = {};
    const list = element("dl", {}, ...LINES.map((line) => {
      this.lines[line] = element(line === "command" ? "code" : "span");
      return element("div", {}, element("dt", {}, WORDS[line]), element("dd", {}, this.lines[line]));
    }));
    this.box = element("li", { class: "bench" }, this.name, element("p", { class: "line" }, this.state, this.who), this.age, this.why, this.bar, list);
  }

  /** @param {BenchEntry} bench @param {number} since_s */
  show(bench, since_s) {
    const { state } = bench;
    setText(this.name, bench.bench);
    setAttribute(this.box, "data-state", state?.state ?? "");
    setAttribute(this.box, "data-old", String(old(bench)));
    setText(this.age, ageText(bench, since_s));
    setText(this.state, state === null ? "no state" : `${STATES[state.state]?.sign ?? "?"} ${state.state}`);
    setText(this.who, state === null ? "" : `${state.motor}${state.simulated ? " \u00b7 simulated" : ""}${state.holder ? ` \u00b7 ${state.holder} is in command` : ""}`);
    const twice = bench.daemons > 1 ? [`${bench.daemons} daemons have this name: give each a [bench] name of its own`] : [];
    setText(this.why, [...(state ? troubles(state) : []), ...twice, bench.problem].filter(Boolean).join(". "));
    this.bar.hidden = !["running", "pausing", "paused"].includes(state?.plan?.state);
    this.bar.value = state?.plan?.fraction ?? 0;
    setAttribute(this.bar, "aria-label", `Progress of the plan of ${bench.bench}`);
    this._line("plan", state ? planText(state.plan) : "");
    this._line("queue", state ? queueText(state.queue) : "");
    this._line("motion", state ? motionText(state) : "");
    this._line("recorder", state ? recorderText(state) : "");
    this._line("command", bench.gone_ns === null ? bench.command : "");
  }

  /** @param {typeof LINES[number]} line @param {string} text */
  _line(line, text) {
    setText(this.lines[line], text);
    this.lines[line].parentElement.parentElement.hidden = text === "";
  }
}

startTheme(byId("theme"));
/** @type {Map<string, Card>} */
const cards = new Map();
/** @type {BenchEntry[]} */
let benches = [];
let received_ms = -Infinity;
let link = { status: "connecting", message: "" };
const socket = new Socket(takeToken(), receive, (status, message) => {
  link = { status, message };
  setHidden(byId("refused"), status !== "refused");
  if (status === "refused") setText(byId("refused-text"), message);
  tick();
});

/** @param {import("./protocol.js").Header} header */
function receive(header) {
  if (header.kind !== "benches") return;
  received_ms = performance.now();
  benches = header.data.benches;
  const names = benches.map((bench) => bench.bench);
  if (names.join("\n") !== [...cards.keys()].join("\n")) arrange(names);
  setHidden(byId("unreachable"), header.data.unreachable.length === 0);
  setText(byId("unreachable"), header.data.unreachable.join(". "));
  setHidden(byId("none"), benches.length > 0);
  setText(byId("summary"), summary(benches));
  tick();
}

/** @param {string[]} names */
function arrange(names) {
  const before = new Map(cards);
  cards.clear();
  for (const name of names) cards.set(name, before.get(name) ?? new Card());
  byId("benches").replaceChildren(...[...cards.values()].map((card) => card.box));
}

/** Ages grow without messages, too: what is old must never look fresh. */
function tick() {
  const since_s = (performance.now() - received_ms) / 1000;
  const stale = link.status !== "open" || since_s > STALE_S;
  setAttribute(document.body, "data-stale", stale ? "true" : null);
  setAttribute(byId("link"), "data-stale", String(stale));
  setText(byId("link-text"), link.status === "refused" ? "not let in" : link.status !== "open" ? `no connection${link.message ? `: ${link.message}` : ""}; trying again` : stale ? "stale" : "live");
  if (!Number.isFinite(since_s)) return;
  for (const bench of benches) cards.get(bench.bench)?.show(bench, since_s);
}

setInterval(tick, TICK_MS);
socket.connect();
