/** Which signals are drawn, in which plot and how: colour, dash and letter together, never colour alone. */

/** @typedef {{name: string, label: string, unit: string, group: string}} Signal */
/** @typedef {Signal & {colour: string, dash: number[] | undefined, tag: string, shown: boolean, digits: number}} Trace */

const SHOWN = ["torque_Nm", "torque_set_Nm", "i_a_A", "i_b_A", "i_c_A", "speed_Hz", "speed_set_Hz", "angle_rad"];
const COLOURS = ["trace-1", "trace-2", "trace-3", "trace-4", "trace-5", "trace-6"];
const DIGITS = { Nm: 3, A: 2, Hz: 3, rad: 3, V: 2, degC: 1, us: 0 };
/** Height of a plot, as a share. @type {Record<string, number>} */
export const SHARE = { torque: 3, current: 2.2, speed: 1.5, angle: 1.2 };

/** @param {Signal} signal @param {number} index in its group @returns {Trace} */
export function traceOf(signal, index) {
  const setpoint = /_set_|^brake_set$/.test(signal.name);
  const commanded = signal.name.includes("_cmd_");
  const phase = /^i_(?:cmd_)?([abc])_A$/.exec(signal.name)?.[1];
  const place = phase ? "abc".indexOf(phase) : index;
  return {
    ...signal,
    unit: signal.unit === "degC" ? "\u00b0C" : signal.unit === "us" ? "\u00b5s" : signal.unit === "1" ? "" : signal.unit,
    colour: setpoint ? "trace-set" : COLOURS[(phase ? place : groupColour(signal, index)) % COLOURS.length],
    dash: setpoint ? [6, 4] : commanded ? [2, 3] : undefined,
    tag: phase ? (commanded ? `${phase}*` : phase) : setpoint ? "set-point" : signal.label,
    shown: SHOWN.includes(signal.name),
    digits: DIGITS[/** @type {keyof typeof DIGITS} */ (signal.unit)] ?? 3,
  };
}

/** @param {Signal} signal @param {number} index */
function groupColour(signal, index) {
  return { torque: 0, current: 0, speed: 2, angle: 3 }[signal.group] ?? index + 3 + index;
}

/**
 * @param {Signal[]} signals
 * @returns {Map<string, Trace[]>} by group, in the order of the server
 */
export function grouped(signals) {
  /** @type {Map<string, Trace[]>} */
  const groups = new Map();
  for (const signal of signals) {
    const group = groups.get(signal.group) ?? [];
    group.push(traceOf(signal, group.length));
    groups.set(signal.group, group);
  }
  return groups;
}

/** What a group is called. @param {string} group */
export function titleOf(group) {
  return { current: "Currents", loop: "Loop timing" }[group] ?? group[0].toUpperCase() + group.slice(1);
}
