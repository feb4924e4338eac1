/** Notes and the list of events. */

import { allow, byId, element } from "./dom.js";
import { clock } from "./format.js";

const LISTED = 100;

export class Notes {
  /** @param {import("./state.js").Bench} bench @param {import("./socket.js").Socket} socket @param {import("./messages.js").Messages} messages */
  constructor(bench, socket, messages) {
    this._bench = bench;
    this._socket = socket;
    this._messages = messages;
    this._list = byId("event-list");
    byId("note-form").addEventListener("submit", (/** @type {SubmitEvent} */ event) => {
      event.preventDefault();
      this._send();
    });
    bench.on("events", (events) => {
      this._list.replaceChildren();
      for (const one of events) this._add(one);
    });
    bench.on("event", (event) => this._add(event));
    for (const kind of /** @type {const} */ (["hello", "link", "connection"])) bench.on(kind, () => this._show());
  }

  focus() {
    byId("note").focus();
  }

  _send() {
    const field = byId("note");
    const text = field.value.trim();
    if (!text) return;
    this._socket.call("note", { text }).then((reply) => {
      field.value = "";
      const where = reply?.recording ? "in the recording" : "among the events; nothing is being recorded";
      this._messages.say("info", `Noted, ${where}.`);
    }, this._messages.failure("note"));
  }

  _show() {
    const why = this._bench.commandObstacle;
    allow(byId("note"), why);
    allow(byId("note-send"), why);
  }

  /** @param {any} event */
  _add(event) {
    const by = event.kind === "note" && event.data?.by ? ` (${event.data.by})` : "";
    this._list.prepend(element("li", { class: `event ${event.kind}` },
      element("time", {}, clock(event.t_ns / 1e9)), " ", element("span", { class: "kind" }, event.kind), ` ${event.message}${by}`));
    if (this._list.children.length > LISTED) this._list.lastElementChild.remove();
  }
}
