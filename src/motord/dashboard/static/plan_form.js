/** The form that starts a plan, made from its settings: units, limits, defaults, help; first a dry run, then the start. */

import { allow, byId, element, setHidden, setText } from "./dom.js";
import { duration, nameAndUnit } from "./format.js";
import { waitsOf } from "./queue_items.js";
import { underWay } from "./state.js";

/**
 * A setting of a plan, as `plan/list` describes it (docs/api.md, "Forms of plans").
 * @typedef {{name: string, type: "number" | "integer" | "list" | "boolean" | "choice" | "text" | "table" | "object" | "other",
 *   default: any, unit: string, minimum: number | null, maximum: number | null, minimum_excluded: boolean,
 *   maximum_excluded: boolean, choices: string[], columns: string[], length_min: number, length_max: number | null,
 *   help: string, optional: boolean}} Field
 */

/** @type {Record<string, string>} */
const UNITS = { degC: "\u00b0C", 1: "" };
const PLAIN = {
  unit: "", minimum: null, maximum: null, minimum_excluded: false, maximum_excluded: false, choices: [], columns: [],
  length_min: 0, length_max: null, help: "", optional: false, default: null,
};

/** The type of a setting without a description, from its value. Pure. @param {any} value @returns {Field["type"]} */
export function typeOf(value) {
  if (typeof value === "boolean") return "boolean";
  if (typeof value === "number" || value === null) return "number";
  if (typeof value === "string") return "text";
  return Array.isArray(value) && value.every((one) => typeof one === "number") ? "list" : "other";
}

/** The fields of a plan of `plan/list`. Pure. @param {any} plan @returns {Field[]} */
export function fieldsOf(plan) {
  const described = plan.fields ?? Object.entries(plan.settings).map(([name, value]) =>
    ({ name, type: typeOf(value), default: value, optional: value === null }));
  return described.map((/** @type {any} */ field) => ({ ...PLAIN, ...field, unit: UNITS[field.unit] || field.unit || nameAndUnit(field.name).unit }));
}

/** The text of a field as the value of a setting. Pure. @param {Field} field @param {string} text @returns {any} @throws {Error} says what is wrong */
export function parse(field, text) {
  const trimmed = text.trim().replaceAll("\u2212", "-");
  if (trimmed === "" && field.optional) return null;
  if (field.type === "choice" || field.type === "text") return trimmed;
  if (["table", "object", "other"].includes(field.type)) return parsedJson(field, trimmed);
  if (field.type !== "list") return checked(field, trimmed);
  const values = trimmed.split(/[\s,;]+/).filter(Boolean).map((one) => checked(field, one));
  const { words } = nameAndUnit(field.name);
  if (values.length < field.length_min) throw new Error(`${words}: at least ${field.length_min} values`);
  if (field.length_max !== null && values.length > field.length_max) throw new Error(`${words}: at most ${field.length_max} values`);
  return values;
}

/** @param {Field} field @param {string} text */
function parsedJson(field, text) {
  try {
    return JSON.parse(text || (field.type === "object" ? "{}" : "[]"));
  } catch {
    throw new Error(`${nameAndUnit(field.name).words}: not JSON`);
  }
}

/** @param {Field} field @param {string} text */
function checked(field, text) {
  const value = Number(text);
  const { words } = nameAndUnit(field.name);
  const { minimum, maximum } = field;
  if (text === "" || !Number.isFinite(value)) throw new Error(`${words}: "${text}" is no number`);
  if (field.type === "integer" && !Number.isInteger(value)) throw new Error(`${words}: a whole number, not ${text}`);
  if (minimum !== null && (field.minimum_excluded ? value <= minimum : value < minimum)) throw new Error(`${words}: ${limits(field)}`);
  if (maximum !== null && (field.maximum_excluded ? value >= maximum : value > maximum)) throw new Error(`${words}: ${limits(field)}`);
  return value;
}

/** @param {Field} field */
function limits({ minimum, maximum, minimum_excluded, maximum_excluded }) {
  const low = minimum === null ? "" : `${minimum_excluded ? "more than" : "at least"} ${minimum}`;
  const high = maximum === null ? "" : `${maximum_excluded ? "less than" : "at most"} ${maximum}`;
  return [low, high].filter(Boolean).join(", ");
}

/** A value as text. @param {any} value */
function shown(value) {
  if (value === null) return "";
  if (Array.isArray(value) && value.every((one) => typeof one === "number")) return value.join(", ");
  return typeof value === "object" ? JSON.stringify(value) : String(value);
}

export class PlanForm {
  /** @param {import("./state.js").Bench} bench @param {import("./socket.js").Socket} socket @param {import("./messages.js").Messages} messages */
  constructor(bench, socket, messages) {
    this._bench = bench;
    this._socket = socket;
    this._messages = messages;
    /** @type {any[]} */
    this._plans = [];
    /** @type {Field[]} */
    this._fields = [];
    this._checked = "";
    this._adding = false;
    byId("plan-choice").addEventListener("change", () => this._choose());
    byId("plan-fields").addEventListener("input", () => this._changed());
    byId("plan-form").addEventListener("submit", (/** @type {SubmitEvent} */ event) => {
      event.preventDefault();
      this._check();
    });
    byId("plan-start").addEventListener("click", () => this._start());
    byId("plan-add").addEventListener("click", () => this._add());
    byId("plan-before-checked").addEventListener("change", () => this._changed());
    byId("plan-serial").addEventListener("input", () => this._changed());
    byId("plan-on-failure").addEventListener("change", () => {
      setHidden(byId("plan-retries-field"), byId("plan-on-failure").value !== "retry");
    });
    bench.on("hello", ({ config }) => {
      setHidden(byId("plan-before"), !config?.calibration?.check_before_plans);
      this._list();
    });
    for (const kind of /** @type {const} */ (["state", "plan", "lease", "link", "connection"])) bench.on(kind, () => this._buttons());
  }

  _list() {
    this._socket.call("plan/list").then(({ plans }) => {
      this._plans = plans;
      const select = byId("plan-choice");
      const before = select.value;
      select.replaceChildren(...plans.map((/** @type {any} */ plan) => element("option", { value: plan.name }, plan.name)));
      if (plans.some((/** @type {any} */ plan) => plan.name === before)) select.value = before;
      else if (plans.some((/** @type {any} */ plan) => plan.name === "calibrate")) select.value = "calibrate";
      this._choose();
    }, this._messages.failure("plans"));
  }

  /** Show the plan that is chosen; what was entered stays unless its settings or their defaults are other ones. */
  _choose() {
    const plan = this._plans.find((one) => one.name === byId("plan-choice").value);
    if (plan === undefined) return;
    setText(byId("plan-summary"), plan.summary + (plan.obstacle ? ` \u26a0 ${plan.obstacle}` : ""));
    const fields = fieldsOf(plan);
    const form = JSON.stringify([plan.name, fields]);
    if (form === this._form) return;
    this._form = form;
    this._fields = fields;
    byId("plan-fields").replaceChildren(...fields.map((field) => row(field)));
    this._changed();
  }

  _changed() {
    this._checked = "";
    setText(byId("plan-outline"), "");
    this._buttons();
  }

  /** What differs from the settings of the bench file. @throws {Error} */
  _settings() {
    /** @type {Record<string, any>} */
    const settings = {};
    for (const field of this._fields) {
      const input = byId(`setting-${field.name}`);
      const value = field.type === "boolean" ? input.checked : parse(field, input.value);
      if (JSON.stringify(value) !== JSON.stringify(field.default)) settings[field.name] = value;
    }
    return settings;
  }

  /** What is sent only where it is given: an older daemon does not know it. */
  _ifGiven() {
    const serial = byId("plan-serial").value.trim();
    return { ...(serial ? { serial } : {}), ...(byId("plan-before-checked").checked ? {} : { check: false }) };
  }

  async _check() {
    const outline = byId("plan-outline");
    this._checked = "";
    try {
      const settings = this._settings();
      setText(outline, "checking\u2026");
      const name = byId("plan-choice").value;
      const reply = await this._socket.call("plan/start", { name, settings, dry_run: true, ...this._ifGiven() });
      this._checked = JSON.stringify([name, settings]);
      setText(outline, `\u2714 within the limits: ${reply.points.length} points, about ${duration(reply.estimate_s)}${reply.outlook ? `; ${reply.outlook}` : ""}`);
    } catch (error) {
      setText(outline, `\u2716 ${/** @type {Error} */ (error).message}`);
    }
    this._buttons();
  }

  _start() {
    const [name, settings] = JSON.parse(this._checked);
    const args = { name, settings, detach: byId("plan-detach").checked, notes: byId("plan-notes").value, ...this._ifGiven() };
    this._checked = "";
    this._buttons();
    this._socket.call("plan/start", args).then(() => {
      byId("plan-start-box").open = false;
      byId("plan").scrollTop = 0; // its progress is at the top
    }, this._messages.failure(`start ${name}`));
  }

  /** The check stays good: the next motor may want the same plan. */
  _add() {
    const [name, settings] = JSON.parse(this._checked);
    const limit = byId("plan-wait-limit");
    const limit_min = limit.valueAsNumber;
    let wait;
    try {
      if (!limit.validity.valid) throw new Error(`for each wait at most: ${limit.validationMessage}`);
      wait = waitsOf(byId("plan-wait").value, Number.isNaN(limit_min) ? null : 60 * limit_min);
      if (wait.length === 0 && !Number.isNaN(limit_min)) throw new Error("a limit for waits, but nothing is waited for");
    } catch (error) {
      this._messages.failure(`add ${name}`)(/** @type {Error} */ (error));
      return;
    }
    const on_failure = byId("plan-on-failure").value;
    const retries = on_failure === "retry" ? { retries: byId("plan-retries").valueAsNumber || 1 } : {};
    const plan = { name, settings, notes: byId("plan-notes").value, on_failure, ...retries, wait, ...this._ifGiven() };
    this._adding = true; // a double click adds it once
    this._buttons();
    this._socket.call("queue/add", { plans: [plan] }).then(({ added }) => {
      this._messages.say("info", `${name} is number ${added.join(", ")} of the queue`);
    }, this._messages.failure(`add ${name}`)).finally(() => {
      this._adding = false;
      this._buttons();
    });
  }

  _buttons() {
    const active = underWay(this._bench.plan) ? "A plan is under way." : "";
    setHidden(byId("plan-queue"), !this._bench.state?.queue);
    allow(byId("plan-add"), this._bench.leaseObstacle || (this._adding ? "It is being added." : "") || (this._checked ? "" : "Check it first."));
    allow(byId("plan-check"), this._bench.link.status === "open" ? "" : "No connection.");
    allow(byId("plan-start"), this._bench.leaseObstacle || active || (this._checked ? "" : "Check it first."));
    setText(byId("plan-start-why"), byId("plan-start").disabled ? byId("plan-start").title : "");
  }
}

/** @param {Field} field */
function row(field) {
  const { words } = nameAndUnit(field.name);
  const id = `setting-${field.name}`;
  const columns = field.columns.length ? `JSON, rows with ${field.columns.join(", ")}` : "";
  const hint = [field.help.replace(/\.$/, ""), limits(field), columns, field.optional ? "may be empty" : ""].filter(Boolean).join("; ");
  const described = hint ? { "aria-describedby": `${id}-hint` } : {};
  return element("div", { class: "field" },
    element("label", { for: id }, words, field.unit ? element("span", { class: "unit" }, field.unit) : null),
    input(field, id, described),
    hint ? element("p", { class: "hint", id: `${id}-hint` }, hint) : null);
}

/** @param {Field} field @param {string} id @param {Record<string, string>} described */
function input(field, id, described) {
  if (field.type === "boolean") return element("input", { id, type: "checkbox", checked: field.default, ...described });
  if (field.type === "choice") {
    return element("select", { id, ...described }, ...field.choices.map((choice) => element("option", { value: choice, selected: choice === field.default }, choice)));
  }
  const numeric = field.type === "number" || field.type === "integer" || field.type === "list";
  return element("input", { id, type: "text", inputmode: numeric ? "decimal" : null, autocomplete: "off", spellcheck: "false", value: shown(field.default), ...described });
}
