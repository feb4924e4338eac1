/** Making and changing elements, without markup in strings: the content security policy allows no inline style. */

/** @param {string} id @returns {any} */
export function byId(id) {
  const found = document.getElementById(id);
  if (found === null) throw new Error(`no element ${id}`);
  return found;
}

/**
 * @param {string} tag
 * @param {Record<string, any>} [attributes] `class`, ARIA and others; `on...` are listeners; true, false and null as usual
 * @param {...(Node | string | null)} children
 * @returns {any}
 */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  fill(made, attributes, children);
  return made;
}

const SVG = "http://www.w3.org/2000/svg";

/** The same for SVG. @param {string} tag @param {Record<string, any>} attributes @param {...(Node | string)} children */
export function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  fill(made, attributes, children);
  return made;
}

/** @param {Element} made @param {Record<string, any>} attributes @param {(Node | string | null)[]} children */
function fill(made, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) made.setAttribute(name, String(value));
  }
  made.append(...children.filter((child) => child !== null));
}

/** Change text only if it is another one: screen readers announce changes, and layout costs. @param {Node} node @param {string} text */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** @param {Element} node @param {string} name @param {string | boolean | null} value */
export function setAttribute(node, name, value) {
  if (value === null || value === false) {
    if (node.hasAttribute(name)) node.removeAttribute(name);
  } else {
    const text = value === true ? "" : value;
    if (node.getAttribute(name) !== text) node.setAttribute(name, text);
  }
}

/** Hide or show only what is not so yet: an observer gets each assignment, a change or not. @param {HTMLElement} node @param {boolean} hidden */
export function setHidden(node, hidden) {
  if (node.hidden !== hidden) node.hidden = hidden;
}

/** A control that is to have the focus once it is allowed, and what has it meanwhile. @type {{id: string, meanwhile: Element} | null} */
let focusNext = null;
const forgetNext = () => { focusNext = null; };

/** Disable a control and say why. @param {any} control @param {string} why "" enables it */
export function allow(control, why) {
  if (control.disabled !== (why !== "")) control.disabled = why !== "";
  setAttribute(control, "title", why || control.dataset.title || null);
  if (why === "" && focusNext?.id === control.id) {
    if (document.activeElement === focusNext.meanwhile) control.focus({ preventScroll: true });
    focusNext = null;
  }
}

/**
 * Focus a control, or `meanwhile` for as long as it is disabled and the person does nothing else. Not for what gives power.
 * @param {HTMLButtonElement} control @param {HTMLElement} meanwhile
 */
export function focusOnceAllowed(control, meanwhile) {
  focusNext = control.disabled ? { id: control.id, meanwhile } : null;
  for (const input of ["keydown", "pointerdown"]) document.addEventListener(input, forgetNext, { capture: true });
  (control.disabled ? meanwhile : control).focus();
}

/** Whether an element is in view: what is scrolled away needs no drawing. `shown` is called when it comes into view. */
export class InView {
  /** @param {Element} target @param {() => void} shown */
  constructor(target, shown) {
    this.now = false;
    new IntersectionObserver((entries) => {
      this.now = entries[entries.length - 1].isIntersecting;
      if (this.now) shown();
    }).observe(target);
  }
}

/** A press or a focus elsewhere closes a list that opens over the page; Escape, which stops the bench, does not.
 * @param {any} list of element `details` @param {HTMLElement} content */
export function closeElsewhere(list, content) {
  const leave = (/** @type {EventTarget | null} */ to) => {
    const covers = getComputedStyle(content).position === "absolute"; // not where it is part of a narrow page
    if (list.open && covers && to instanceof Node && !list.contains(to)) list.open = false;
  };
  document.addEventListener("pointerdown", (event) => leave(event.target));
  list.addEventListener("focusout", (/** @type {FocusEvent} */ event) => leave(event.relatedTarget));
}
