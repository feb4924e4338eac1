/** Answers and mishaps, in words, one below the other until they are dismissed or old. */

import { byId, element } from "./dom.js";
import { clock } from "./format.js";

const SHOWN_MS = { info: 8000, warning: 30000, error: 60000 };
const MOST = 4;
const SIGN = { info: "\u2139", warning: "\u26a0", error: "\u2716" };

export class Messages {
  constructor() {
    this._polite = byId("messages");
  }

  /** @param {"info" | "warning" | "error"} kind @param {string} text */
  say(kind, text) {
    const same = this._polite.lastElementChild;
    if (same?.dataset.text === text) same.remove();
    const close = element("button", { type: "button", class: "close", "aria-label": "Dismiss" }, "\u00d7");
    const box = element("div", { class: `message ${kind}` },
      element("span", { class: "sign", "aria-hidden": "true" }, SIGN[kind]),
      element("span", {}, `${clock(Date.now() / 1000)} ${text}`), close);
    box.dataset.text = text;
    close.addEventListener("click", () => box.remove());
    this._polite.append(box);
    while (this._polite.children.length > MOST) this._polite.firstElementChild?.remove();
    setTimeout(() => box.remove(), SHOWN_MS[kind]);
  }

  /** For the end of a call. @param {string} what was tried @returns {(error: Error) => void} */
  failure(what) {
    return (error) => this.say("error", `${what}: ${error.message}`);
  }
}
