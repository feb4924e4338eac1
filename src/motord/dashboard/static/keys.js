/** Keys that act anywhere. Escape always stops; the letters can be turned off (WCAG 2.1.4). */

import { byId } from "./dom.js";

const KEY = "motord.letters";

/** @param {EventTarget | null} target */
function typing(target) {
  return target instanceof HTMLElement && (target.matches("input:not([type=checkbox]):not([type=range]), textarea, select") || target.isContentEditable);
}

/**
 * @param {() => void} stop
 * @param {Record<string, () => void>} letters
 */
export function startKeys(stop, letters) {
  const allowed = byId("letters");
  allowed.checked = localStorage.getItem(KEY) !== "off";
  allowed.addEventListener("change", () => localStorage.setItem(KEY, allowed.checked ? "on" : "off"));
  addEventListener("keydown", (event) => {
    if (event.key === "Escape" && !event.repeat) {
      event.preventDefault();
      stop();
      return;
    }
    if (!allowed.checked || event.ctrlKey || event.altKey || event.metaKey || event.repeat || typing(event.target)) return;
    const action = letters[event.key];
    if (action !== undefined) {
      event.preventDefault();
      action();
    }
  }, { capture: true });
}
