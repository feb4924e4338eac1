/** What the queue's items and their runs say, as text. Pure. */

import { clock, duration, nameAndUnit } from "./format.js";
import { underWay } from "./state.js";

/** @typedef {{channel?: string | null, below?: number | null, above?: number | null, until?: string | null, limit_s?: number | null}} Wait */
/** @typedef {{name: string, settings: Record<string, any>, notes: string, serial?: string | null, wait: Wait[], on_failure: string, retries: number}} Plan */
/** @typedef {{id: number, plan: Plan, estimate_s: number, added_by: string, state: string, failures: number}} Item */
/** @typedef {{id: number, plan: string, state: string, message: string, kept: boolean, recording: string, ended_ns: number}} Run */

export const WORDS = {
  queued: "queued", running: "\u25b6 running", waiting: "waiting", pausing: "\u275a\u275a pausing", paused: "\u275a\u275a paused",
  done: "\u2714 done", failed: "\u2716 failed", aborted: "\u25a0 aborted", interrupted: "\u26a0 interrupted",
};

/** @param {string} state */
export const stateText = (state) => WORDS[/** @type {keyof typeof WORDS} */ (state)] ?? state;

const PLAN = { settings: {}, notes: "", serial: null, wait: [], on_failure: "stop", retries: 1 };

/** A plan as the daemon gives it, which leaves out what was not given. @param {Partial<Plan> & {name: string}} plan @returns {Plan} */
export const whole = (plan) => ({ ...PLAN, ...plan });

const SETTING_MAX = 60;

/** Settings that differ from the bench file's. @param {Record<string, any>} settings */
export function settingsText(settings) {
  return Object.entries(settings).map(([name, value]) => {
    const { words, unit } = nameAndUnit(name);
    const numbers = Array.isArray(value) && value.every((one) => typeof one !== "object");
    const text = numbers ? value.join(", ") || "none" : value !== null && typeof value === "object" ? JSON.stringify(value) : String(value ?? "none");
    const short = text.length > SETTING_MAX ? `${text.slice(0, SETTING_MAX)}\u2026` : text;
    return `${words} ${short}${unit ? ` ${unit}` : ""}`;
  }).join(" \u00b7 ");
}

/** @param {Wait} wait */
export function waitText({ channel, below = null, above, until = null, limit_s = null }) {
  const condition = until !== null ? `until ${until}` : `${channel} ${below !== null ? `below ${below}` : `above ${above}`}`;
  return condition + (limit_s !== null ? `, at most ${duration(limit_s)}` : "");
}

/**
 * Waits as they are entered: `until 06:00; winding_C below 40`, each at most `limit_s`. The daemon checks channels and times.
 * @param {string} text @param {number | null} limit_s @returns {Wait[]} @throws {Error} says what is wrong
 */
export function waitsOf(text, limit_s = null) {
  const limit = limit_s === null ? {} : { limit_s };
  return text.split(";").map((one) => one.trim()).filter(Boolean).map((one) => {
    const [, until] = /^until\s+(\S+)$/i.exec(one) ?? [];
    if (until !== undefined) return { until, ...limit };
    const [, channel, side, value] = /^(\S+)\s+(below|above)\s+(\S+)$/i.exec(one) ?? [];
    const bound = Number(value?.replaceAll("\u2212", "-"));
    if (channel === undefined || !Number.isFinite(bound)) throw new Error(`"${one}" is no wait: until HH:MM, CHANNEL below VALUE or CHANNEL above VALUE`);
    return { channel, [side.toLowerCase() === "below" ? "below" : "above"]: bound, ...limit };
  });
}

/** What the queue does if the plan fails. @param {Plan} plan */
export function policyText({ on_failure, retries }) {
  if (on_failure === "retry") return `if it fails: again, at most ${retries === 1 ? "once" : `${retries} times`}`;
  return on_failure === "skip" ? "if it fails: skipped" : "if it fails: the queue pauses";
}

/**
 * How its runs have ended so far, "" before the first.
 * @param {Item} item @param {Run[]} history the newest last
 */
export function attemptsText(item, history) {
  const runs = history.filter((run) => run.id === item.id);
  const last = runs[runs.length - 1];
  if (last === undefined) return "";
  const count = runs.length === 1 ? "1 attempt" : `${runs.length} attempts`;
  return `${count}; ${last.state} at ${clock(last.ended_ns / 1e9)}${last.message ? `: ${last.message}` : ""}`;
}

/** The place of an item for `queue/move` one step up (-1) or down (1), null at the ends and for the one under way.
 * @param {Item[]} items @param {number} id @param {number} step */
export function place(items, id, step) {
  const movable = items.filter((item) => item.state !== "running");
  const to = movable.findIndex((item) => item.id === id) + step;
  const there = movable.some((item) => item.id === id);
  return there && to >= 0 && to < movable.length ? to + 1 : null;
}

/** How long an item still takes. @param {Item} item @param {any} plan the plan under way as the state has it */
export function timeText(item, plan) {
  if (item.state === "running" && underWay(plan)) return `${duration(plan.eta_s)} to go`;
  return `about ${duration(item.estimate_s)}`;
}
