/** Light and dark: the choice, and the colours of the style sheet for what is drawn on canvas. */

const KEY = "motord.theme";
const NAMES = /** @type {const} */ (["auto", "light", "dark"]);

/** @type {Set<() => void>} */
const listeners = new Set();
/** @type {Map<string, string>} */
const resolved = new Map();
let motion = /** @type {MediaQueryList | null} */ (null);
let probe = /** @type {HTMLElement | null} */ (null);

/** The colour that `--name` has now. @param {string} name @returns {string} */
export function colour(name) {
  let found = resolved.get(name);
  if (found === undefined) {
    if (probe === null) {
      probe = document.createElement("span");
      probe.hidden = true;
      document.body.append(probe);
    }
    probe.style.color = `var(--${name})`;
    found = getComputedStyle(probe).color;
    resolved.set(name, found);
  }
  return found;
}

/** @param {() => void} redraw called when the colours are others */
export function onTheme(redraw) {
  listeners.add(redraw);
}

function changed() {
  resolved.clear();
  for (const redraw of listeners) redraw();
}

/** @param {HTMLSelectElement} select auto, light, dark */
export function startTheme(select) {
  const kept = localStorage.getItem(KEY);
  select.value = NAMES.find((name) => name === kept) ?? "auto";
  const apply = () => {
    document.documentElement.dataset.theme = select.value;
    localStorage.setItem(KEY, select.value);
    changed();
  };
  select.addEventListener("change", apply);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changed);
  apply();
}

/** Whether movement is to be little. */
export function reducedMotion() {
  motion ??= matchMedia("(prefers-reduced-motion: reduce)");
  return motion.matches;
}
