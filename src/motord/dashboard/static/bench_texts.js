/** What the overview says of a bench. Pure. */

import { age, clock, duration, NO_VALUE, number, significant } from "./format.js";
import { stateText } from "./queue_items.js";
import { underWay } from "./state.js";

/** A bench as the server describes it. @typedef {{bench: string, silent: boolean, age_s: number | null, daemons: number,
 * problem: string, gone_ns: number | null, command: string, state: any}} BenchEntry */

/** Whether what is known of it is not what is. @param {BenchEntry} bench */
export const old = (bench) => bench.gone_ns !== null || bench.silent;

/** How many there are, and of how many somebody should know. @param {BenchEntry[]} benches */
export function summary(benches) {
  const there = benches.filter((one) => one.gone_ns === null);
  const counted = [
    [there.filter((one) => !one.silent && one.state?.state === "TRIPPED").length, "tripped"],
    [there.filter((one) => !one.silent && one.state?.plan?.state === "running").length, "with a plan"],
    [there.filter((one) => one.silent).length, "silent"],
  ].filter(([count]) => count);
  const gone = benches.length - there.length;
  const all = `${there.length} ${there.length === 1 ? "bench" : "benches"}`;
  const some = counted.length ? `: ${counted.map(([count, what]) => `${count} ${what}`).join(", ")}` : "";
  return all + some + (gone ? `; ${gone} vanished` : "");
}

/** How old what is shown is. @param {BenchEntry} bench @param {number} since_s its message came */
export function ageText(bench, since_s) {
  if (bench.gone_ns !== null) return `vanished at ${clock(bench.gone_ns / 1e9)}: its daemon has ended, or the way to it is gone`;
  if (bench.age_s === null) return bench.state === null ? "silent: no answer" : `silent: the last state is of ${clock(bench.state.t_ns / 1e9)}`;
  return (bench.silent ? "silent for " : "") + age(bench.age_s + since_s) + (bench.silent ? "" : " old");
}

/** Why it tripped and what to do, or what is wrong. @param {any} state @returns {string[]} */
export function troubles(state) {
  const first = (/** @type {any} */ trip) => trip.name !== state.first_trip;
  const trips = state.state === "TRIPPED" ? [...state.trips].sort((a, b) => Number(first(a)) - Number(first(b))) : [];
  return [
    ...trips.map((trip) => `${trip.name}: ${trip.meaning}`),
    ...(trips.length && state.action ? [`What to do: ${state.action}; then reset`] : []),
    ...(state.fault ? [state.fault] : []),
    ...(state.remedy ? [`What to do: ${state.remedy}`] : []),
  ];
}

/** @param {any} plan */
export function planText(plan) {
  if (plan === null) return "none";
  const most = Object.keys(plan.targets ?? {}).length ? "at most " : "";
  return [
    `${plan.plan} ${stateText(plan.state)}${plan.serial ? `, serial ${plan.serial}` : ""}`, `${plan.points_done} of ${plan.points} points`,
    !underWay(plan) ? plan.message : `${number(100 * plan.fraction, 0)} %, ${most}${duration(plan.eta_s)} to go`,
  ].filter(Boolean).join(" \u00b7 ");
}

/** @param {any} queue */
export const queueText = (queue) =>
  queue && queue.length ? `${stateText(queue.state)} \u00b7 ${queue.length} ${queue.length === 1 ? "plan" : "plans"}, about ${duration(queue.eta_s)}` : "";

/** Torque and speed; of a sensor that does not pass the mean the set-point alone says how much. @param {any} state */
export function motionText(state) {
  if (state.torque_set_Nm === null) return "";
  const measured = state.mean_measured && state.torque_Nm !== null ? `${significant(state.torque_Nm)} of ` : "";
  const speed = state.speed_Hz === null ? NO_VALUE : `${number(state.speed_Hz, 2)} Hz`;
  return `${measured}${significant(state.torque_set_Nm)} Nm set \u00b7 ${speed}`;
}

/** @param {any} state */
export const recorderText = (state) =>
  `${state.recording ? `\u25cf ${state.recording_name}` : "not recording"}${state.recording_trouble ? `: ${state.recording_trouble}` : ""}`;
