/** The plots over time: which window is asked for, frames drawn, cursor, pause and zoom by mouse and keys. */

import { Buckets } from "./buckets.js";
import { byId, closeElsewhere, element, setAttribute, setHidden, setText } from "./dom.js";
import { age, beforeNow, clock, decimals } from "./format.js";
import { FrameTiming } from "./frame_timing.js";
import { SHARE, grouped, titleOf } from "./signals.js";
import { onTheme, reducedMotion } from "./theme.js";
import { TracePlot } from "./trace_plot.js";
import { SPANS_S, TimeWindow } from "./window.js";

const VIEW = 1;
const VALUES_MS = 120;
const CALM_MS = 250;
/** So many times as long as drawing takes passes from frame to frame: a slow computer draws less often and stays usable. */
const DRAWING_SHARE = 2.5;
const MAX_BUCKETS = 1600;

export class Traces {
  /** @param {import("./state.js").Bench} bench @param {import("./socket.js").Socket} socket @param {import("./marks.js").Marks} marks */
  constructor(bench, socket, marks) {
    this._bench = bench;
    this._socket = socket;
    this._marks = marks;
    this._buckets = new Buckets();
    this._window = new TimeWindow();
    /** @type {Map<string, import("./signals.js").Trace[]>} */
    this._groups = new Map();
    /** @type {TracePlot[]} */
    this._plots = [];
    /** @type {number | null} as a share of the window */
    this._cursor = null;
    this._to_s = 0;
    this._dirty = this._waiting = false;
    this._drawn_ms = this._shown_ms = this._cost_ms = 0;
    this._timing = new FrameTiming();
    this._lost = 0;
    this._frame = (/** @type {number} */ now_ms) => this._draw(now_ms);
    this._area = byId("plots");
    this._controls();
    onTheme(() => this._rebuild());
    bench.on("age", () => this.refresh());
    new ResizeObserver(() => this._resized()).observe(this._area);
  }

  /** The signals are known. @param {import("./signals.js").Signal[]} signals @param {number} history_s */
  start(signals, history_s) {
    this._window.history_s = history_s;
    const names = signals.map((signal) => signal.name).join();
    if (names !== this._names) {
      this._names = names;
      this._groups = grouped(signals);
      this._signalChoice();
      this._layout();
    }
    for (const trace of this._groups.get("torque") ?? []) trace.digits = this._bench.torqueDigits + 1;
    this._ask();
  }

  /** @param {any} header @param {Float32Array} floats */
  take(header, floats) {
    if (header.view !== VIEW || header.live !== this._window.live) return;
    if (this._buckets.take(header, floats)) this._fit();
    this._lost = header.lost;
    this._timing.take(header);
    this._dirty = true;
    this._request();
  }

  /** Draw again with the next frame. */
  refresh() {
    this._dirty = true;
    this._request();
  }

  /** Ask for a frame; until it is time for it the browser makes none. @param {number} [wait_ms] */
  _request(wait_ms = 0) {
    if (this._waiting || document.hidden) return;
    this._waiting = true;
    if (wait_ms > 0) setTimeout(() => requestAnimationFrame(this._frame), wait_ms);
    else requestAnimationFrame(this._frame);
  }

  /** @param {number} now_ms */
  _draw(now_ms) {
    this._waiting = false;
    if (!this._dirty || document.hidden || this._buckets.count === 0) return;
    const pause_ms = reducedMotion() ? CALM_MS : DRAWING_SHARE * this._cost_ms;
    const wait_ms = this._drawn_ms + pause_ms - now_ms;
    if (wait_ms > 0) return this._request(wait_ms);
    this._dirty = false;
    this._drawn_ms = now_ms;
    const to_s = this._window.end_s ?? this._buckets.end_s;
    this._to_s = to_s;
    const begun_ms = performance.now();
    for (const plot of this._plots) plot.draw(this._buckets, to_s, this._window.span_s, this._window.live);
    this._cost_ms += 0.2 * (performance.now() - begun_ms - this._cost_ms);
    this._timing.drawn(this._bench.epoch_s, Date.now());
    if (now_ms - this._shown_ms < VALUES_MS && this._cursor === null) return;
    this._shown_ms = now_ms;
    this._values();
  }

  _values() {
    for (const plot of this._plots) plot.showValues(this._buckets, this._cursor_s);
    const at = this._cursor_s;
    const epoch_s = this._bench.epoch_s;
    const near = at === null ? null : this._marks.near(at, this._window.span_s / 80);
    setText(byId("cursor-time"), at === null ? "" : `${clock(epoch_s + at, 3)}${near ? ` \u00b7 ${near.sign} ${near.text}` : ""}`);
    setText(byId("lost"), this._lost ? `${this._lost} ticks lost on the way` : "");
  }

  get _bucketsWanted() {
    const width = this._plots[0]?.canvas.clientWidth || 600;
    return Math.round(Math.min(MAX_BUCKETS, Math.max(120, (width - 50) * Math.min(devicePixelRatio, 2))));
  }

  /** Ask the server for what is to be seen. */
  _ask() {
    const signals = this._shown().flatMap(([, traces]) => traces.map((trace) => trace.name));
    const buckets = (this._asked = this._bucketsWanted);
    const { span_s, end_s } = this._window;
    this._socket.send({ kind: "view", view: VIEW, span_s, end_s, buckets, signals });
    this._buttons();
  }

  /** @returns {[string, import("./signals.js").Trace[]][]} */
  _shown() {
    const groups = [...this._groups].map(([group, traces]) => [group, traces.filter((trace) => trace.shown)]);
    return /** @type {any} */ (groups.filter(([, traces]) => traces.length));
  }

  _layout() {
    for (const plot of this._plots) plot.uplot?.destroy();
    const shown = this._shown();
    this._plots = shown.map(([group, traces], i) => new TracePlot(group, traces, {
      limits: () => this._limits(group),
      marks: () => this._marks.all,
      axis: i === shown.length - 1,
      old: () => this._bench.ticksStale,
      time: (t_s, step_s) => this._time(t_s, step_s),
      select: (from, to) => this._change(() => this._window.select(this._at(from), this._at(to))),
      cursor: (at) => this._moved(at),
      shown: () => this.refresh(),
    }));
    this._area.replaceChildren(...this._plots.map((plot) => plot.element));
    this._plots.forEach((plot, i) => {
      const share = SHARE[plot.group] ?? 1.2;
      plot.element.style.flexGrow = String(share);
      plot.element.classList.toggle("last", i === this._plots.length - 1);
    });
    this._rebuild();
  }

  _rebuild() {
    for (const plot of this._plots) plot.build(this._buckets);
    this.refresh();
  }

  _fit() {
    for (const plot of this._plots) plot.fit(this._buckets);
    this.refresh();
  }

  _resized() {
    clearTimeout(this._timer);
    this._timer = setTimeout(() => {
      if (!this._plots.every((plot) => plot.fits)) this._fit();
      if (this._groups.size && this._bucketsWanted !== this._asked) this._ask(); // also of what was fitted meanwhile
    }, 100);
  }

  /** @param {string} group */
  _limits(group) {
    return group === "torque" ? this._bench.torqueLimits : NO_LIMITS;
  }

  /** A time of the axis as text: live it counts from now. @param {number} t_s @param {number} step_s */
  _time(t_s, step_s) {
    const { live, span_s } = this._window;
    return live ? beforeNow(t_s, step_s, span_s, this._bench.ticksStale) : clock(this._bench.epoch_s + t_s, Math.min(4, decimals(step_s)));
  }

  /** The time at a share of the window as it is drawn. @param {number} share */
  _at(share) {
    return this._to_s - (1 - share) * this._window.span_s;
  }

  get _cursor_s() {
    return this._cursor === null ? null : this._at(this._cursor);
  }

  /** @param {number | null} at */
  _moved(at) {
    if (at === this._cursor) return;
    this._cursor = at;
    this._values();
  }

  /** @param {() => void} change of the window */
  _change(change) {
    change();
    this._ask();
    this.refresh();
  }

  togglePause() {
    this._change(() => (this._window.live ? this._window.pause(this._buckets.end_s) : this._window.resume()));
  }

  /** @param {number} direction */
  zoom(direction) {
    this._change(() => this._window.zoom(direction, this._cursor_s));
  }

  /** @param {number} fraction */
  pan(fraction) {
    this._change(() => this._window.pan(fraction, this._bench.now_s ?? this._buckets.end_s));
  }

  /** Move the cursor from key to key. @param {number} direction */
  moveCursor(direction) {
    const plot = this._plots[0]?.uplot;
    if (!plot) return;
    const width = plot.bbox.width / devicePixelRatio;
    const left = plot.cursor.left >= 0 ? plot.cursor.left : width / 2;
    const to = Math.min(Math.max(left + (direction * width) / 100, 0), width);
    plot.setCursor({ left: to, top: 10 });
  }

  _controls() {
    const span = byId("span");
    span.append(...SPANS_S.map((s) => element("option", { value: s }, s < 60 ? `${s} s` : `${s / 60} min`)));
    span.addEventListener("change", () => {
      if (Number(span.value)) this._change(() => this._window.setSpan(Number(span.value)));
    });
    byId("pause-traces").addEventListener("click", () => this.togglePause());
    byId("zoom-in").addEventListener("click", () => this.zoom(-1));
    byId("zoom-out").addEventListener("click", () => this.zoom(1));
    byId("back").addEventListener("click", () => this.pan(-0.5));
    byId("forward").addEventListener("click", () => this.pan(0.5));
    closeElsewhere(byId("signals"), byId("signal-choice"));
    this._area.addEventListener("wheel", (/** @type {WheelEvent} */ event) => this._wheel(event), { passive: false });
    this._area.addEventListener("dblclick", () => !this._window.live && this.togglePause());
    this._area.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => this._key(event));
  }

  /** The wheel zooms; without Ctrl or Shift only where the pointer was put on the plots on purpose: they have the focus.
   * @param {WheelEvent} event */
  _wheel(event) {
    if (matchMedia("(max-width: 1099px)").matches && !event.ctrlKey && !event.shiftKey) return; // a page that scrolls
    event.preventDefault();
    if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) this.pan(Math.sign(event.deltaX) * 0.1);
    else if (event.deltaY) this.zoom(Math.sign(event.deltaY));
  }

  /** @param {KeyboardEvent} event */
  _key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const step = event.shiftKey ? 10 : 1;
    /** @type {Record<string, () => void>} */
    const actions = {
      " ": () => this.togglePause(), "+": () => this.zoom(-1), "=": () => this.zoom(-1), "-": () => this.zoom(1),
      ArrowLeft: () => this.moveCursor(-step), ArrowRight: () => this.moveCursor(step),
      PageUp: () => this.pan(-0.5), PageDown: () => this.pan(0.5),
      End: () => !this._window.live && this.togglePause(),
    };
    const action = actions[event.key];
    if (action === undefined) return;
    event.preventDefault();
    action();
  }

  _buttons() {
    const { live, span_s, end_s } = this._window;
    const pause = byId("pause-traces");
    setText(pause, live ? "\u275a\u275a Pause" : "\u25b6 Live");
    setAttribute(pause, "aria-pressed", String(!live));
    const span = byId("span");
    if (SPANS_S.includes(span_s)) span.value = String(span_s);
    else {
      byId("span-other").textContent = age(span_s);
      span.value = "other";
    }
    setHidden(byId("span-other"), SPANS_S.includes(span_s));
    setAttribute(this._area, "data-live", String(live));
    setText(byId("held"), end_s === null ? "" : `held at ${clock(this._bench.epoch_s + end_s, 1)}`);
  }

  _signalChoice() {
    const sets = [...this._groups].map(([group, traces]) => {
      const boxes = traces.map((trace) => {
        const box = element("input", { type: "checkbox" });
        box.checked = trace.shown;
        box.addEventListener("change", () => {
          trace.shown = box.checked;
          this._layout();
          this._ask();
        });
        return element("label", {}, box, ` ${trace.label}${trace.unit ? ` (${trace.unit})` : ""}`);
      });
      return element("fieldset", {}, element("legend", {}, titleOf(group)), ...boxes);
    });
    byId("signal-choice").replaceChildren(...sets);
  }
}

/** @type {{value: number, label: string}[]} */
const NO_LIMITS = [];
