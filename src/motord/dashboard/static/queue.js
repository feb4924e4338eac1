/** The queue of plans as the daemon reported it; start, pause, stop, move and remove. */

import { allow, byId, element, focusOnceAllowed, setAttribute, setHidden, setText } from "./dom.js";
import { clock, duration } from "./format.js";
import { attemptsText, place, policyText, settingsText, stateText, timeText, waitText, whole } from "./queue_items.js";

const HISTORY_SHOWN = 10;

/** @typedef {import("./queue_items.js").Item} Item */

export class PlanQueue {
  /** @param {import("./state.js").Bench} bench @param {import("./socket.js").Socket} socket @param {import("./messages.js").Messages} messages */
  constructor(bench, socket, messages) {
    this._bench = bench;
    this._socket = socket;
    this._messages = messages;
    this._key = "";
    this._button("start", () => this._call("queue/start", { detach: byId("queue-detach").checked }));
    this._button("pause", () => this._call("queue/pause"));
    this._button("stop", () => this._stop());
    byId("queue-items").addEventListener("click", (/** @type {MouseEvent} */ event) => {
      const button = /** @type {HTMLElement} */ (event.target).closest("button");
      // the second click of a double click may be on the row that came in the place of a removed one
      if (button && (event.detail < 2 || button.dataset.does !== "remove")) this._edit(Number(button.dataset.item), button.dataset.does ?? "");
    });
    bench.on("queue", () => this._showItems());
    for (const kind of /** @type {const} */ (["state", "lease", "link", "connection"])) bench.on(kind, () => this._show());
  }

  get _items() {
    return /** @type {Item[]} */ (this._bench.queue?.items ?? []);
  }

  /** @param {string} id @param {() => void} clicked */
  _button(id, clicked) {
    byId(`queue-${id}`).addEventListener("click", clicked);
  }

  /** @param {string} name @param {Record<string, any>} [args] */
  _call(name, args = {}) {
    return this._socket.call(name, args).catch(this._messages.failure(name.replace("/", " ")));
  }

  /** Pause first: of a plan that is aborted the next one must not begin. */
  async _stop() {
    try {
      const { items } = await this._socket.call("queue/pause");
      if (items.some((/** @type {Item} */ item) => item.state === "running")) await this._socket.call("plan/abort");
    } catch (error) {
      this._messages.failure("queue stop")(/** @type {Error} */ (error));
    }
  }

  /** @param {number} id @param {string} what */
  _edit(id, what) {
    if (what === "remove") return this._call("queue/remove", { ids: [id] });
    const position = place(this._items, id, what === "up" ? -1 : 1);
    return position === null ? undefined : this._call("queue/move", { id, position });
  }

  _show() {
    const queue = this._bench.state?.queue ?? null;
    setHidden(byId("queue"), queue === null);
    if (queue === null) return;
    const empty = queue.length === 0;
    setAttribute(byId("queue"), "data-empty", empty && queue.state === "paused");
    setAttribute(byId("queue-state"), "data-state", empty ? "" : queue.state);
    setText(byId("queue-state"), empty ? "empty" : stateText(queue.state) + (queue.detached ? " (detached)" : ""));
    setText(byId("queue-count"), empty ? "" : `${queue.length} ${queue.length === 1 ? "plan" : "plans"}${queue.done ? ` \u00b7 ${queue.done} done` : ""}${queue.failed ? ` \u00b7 ${queue.failed} failed` : ""}`);
    setText(byId("queue-time"), empty ? "" : `about ${duration(queue.eta_s)} to go`);
    setText(byId("queue-message"), queue.message);
    this._controls(queue);
    for (const item of this._items) {
      const time = document.getElementById(`queue-time-${item.id}`);
      if (time) setText(time, timeText(item, this._bench.plan));
    }
  }

  /** @param {any} queue */
  _controls(queue) {
    const why = this._bench.leaseObstacle;
    const active = queue.state !== "paused";
    allow(byId("queue-start"), why || (queue.length === 0 ? "The queue is empty." : active && queue.state !== "pausing" ? "It runs." : ""));
    allow(byId("queue-pause"), why || (!active ? "It is paused." : queue.state === "pausing" ? "It is pausing." : ""));
    allow(byId("queue-stop"), why || (active || queue.running !== null ? "" : "Nothing of it runs."));
    for (const button of byId("queue-items").querySelectorAll("button")) allow(button, why || button.dataset.why);
  }

  /** Rows are made anew, seldom; the focus stays on its button, or goes to the next that can be used, or to the empty queue. */
  _showItems() {
    const key = JSON.stringify(this._bench.queue);
    if (key === this._key) return;
    this._key = key;
    const list = byId("queue-items");
    const focus = list.contains(document.activeElement) ? /** @type {HTMLElement} */ (document.activeElement) : null;
    const at = focus ? [...list.children].findIndex((row) => row.contains(focus)) : -1;
    const history = this._bench.queue?.history ?? [];
    const rows = this._items.map((item) => this._row(item, history));
    list.replaceChildren(...rows);
    setHidden(list, rows.length === 0);
    const ended = history.slice(-HISTORY_SHOWN).reverse().map((run) => runRow(run, this._items));
    setHidden(byId("queue-ended"), ended.length === 0);
    byId("queue-history").replaceChildren(...ended);
    this._show();
    if (focus !== null) this._focus(focus.id, rows[Math.min(at, rows.length - 1)]);
  }

  /** @param {string} id @param {HTMLElement | undefined} row */
  _focus(id, row) {
    const same = /** @type {HTMLButtonElement | null} */ (id ? document.getElementById(id) : null);
    const near = same?.closest("li") ?? row;
    const usable = same && !same.dataset.why ? same : near?.querySelector('button[data-why=""]');
    const list = byId(row ? "queue-items" : "queue");
    if (usable) focusOnceAllowed(/** @type {HTMLButtonElement} */ (usable), list);
    else list.focus();
  }

  /** @param {Item} item @param {any[]} history */
  _row(item, history) {
    const plan = whole(item.plan);
    const waits = plan.wait.map(waitText).join("; ");
    const tried = attemptsText(item, history);
    const about = [plan.serial ? `serial ${plan.serial}` : "", settingsText(plan.settings), plan.notes, waits ? `waits ${waits}` : "", policyText(plan)];
    return element("li", { "data-id": item.id },
      element("p", { class: "line" },
        element("span", {}, `${item.id} `, element("strong", {}, plan.name), " ", element("span", { class: "plan-state", "data-state": item.state }, stateText(item.state))),
        element("span", { class: "small", id: `queue-time-${item.id}` }, timeText(item, this._bench.plan))),
      element("div", { class: "queue-row" },
        element("p", { class: "small soft" }, about.filter(Boolean).join(" \u00b7 ")),
        element("span", { class: "queue-buttons" }, this._edits(item, "up", "\u25b2", "Move up"), this._edits(item, "down", "\u25bc", "Move down"), this._edits(item, "remove", "\u00d7", "Remove"))),
      tried ? element("p", { class: "small attempts" }, tried) : null);
  }

  /** @param {Item} item @param {string} what @param {string} sign @param {string} words */
  _edits(item, what, sign, words) {
    const fixed = item.state === "running" ? "This plan is running." : "";
    const end = what !== "remove" && place(this._items, item.id, what === "up" ? -1 : 1) === null ? "It is first or last already." : "";
    return element("button", {
      type: "button", id: `queue-${what}-${item.id}`, "data-item": item.id, "data-does": what, "data-why": fixed || end,
      "data-title": words, "aria-label": `${words}: ${item.id} ${item.plan.name}`, disabled: true,
    }, sign);
  }
}

/** @param {import("./queue_items.js").Run} run @param {Item[]} items those in the queue now */
function runRow(run, items) {
  const recording = run.recording ? run.recording.split("/").pop() : "";
  const still = items.some(({ id }) => id === run.id) ? "still in the queue" : "";
  const about = [run.message, still, recording].filter(Boolean).join(" \u00b7 ");
  return element("li", {}, `${clock(run.ended_ns / 1e9)} ${run.id} ${run.plan} `,
    element("span", { class: "plan-state", "data-state": run.state }, stateText(run.state)), about ? ` ${about}` : "");
}
