/** Numbers, times and units as text; ranges of axes. Pure. */

const MINUS = "\u2212";
export const NO_VALUE = "\u2013";

/**
 * @param {number | null | undefined} value
 * @param {number} digits decimals
 */
export function number(value, digits) {
  if (value === null || value === undefined || !Number.isFinite(value)) return NO_VALUE;
  const text = value.toFixed(digits);
  if (Number(text) === 0) return text.replace("-", "");
  return text.replace("-", MINUS);
}

/** Three significant digits, as instruments show them. @param {number | null | undefined} value */
export function significant(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return NO_VALUE;
  const magnitude = Math.abs(value);
  if (magnitude >= 1e5 || (magnitude > 0 && magnitude < 1e-3)) {
    return value.toExponential(digits - 1).replace("-", MINUS);
  }
  if (magnitude === 0) return "0";
  return number(value, Math.max(0, digits - 1 - Math.floor(Math.log10(magnitude))));
}

/** `speed: 26 rad/s, limit 25 rad/s` of the quantity `speed, rad/s`, as `api.published_message.quantity_text`.
 * @param {string} quantity @param {string} value @param {string} limit
 */
export function quantityText(quantity, value, limit) {
  const [, what, unit] = /^(.+), (.+?)$/.exec(quantity) ?? [];
  if (what === undefined || unit === undefined) return `${quantity}: ${value}, limit ${limit}`;
  if (unit === "for s") return `${what} for ${value} s, limit ${limit} s`;
  return `${what}: ${value} ${unit}, limit ${limit} ${unit.split(" ")[0]}`;
}

/** Decimals that show half of an interval with two digits. @param {number} half above 0 */
export const halfDigits = (half) => Math.min(Math.max(1 - Math.floor(Math.log10(half) + 1e-9), 0), 12);

/** Decimals for some estimates: `least`, and one digit of the smallest half of their intervals. @param {(number | null)[]} halves @param {number} least */
export function commonDigits(halves, least) {
  const known = halves.filter((half) => half !== null && half > 0).map(Number);
  return known.length ? Math.max(least, halfDigits(Math.min(...known)) - 1) : least;
}

/** Value and half of its interval, with two digits of the latter. @param {number} value @param {number} half */
export function plusMinus(value, half) {
  if (!Number.isFinite(half) || half <= 0) return significant(value, 4);
  const digits = halfDigits(half);
  return `${number(value, digits)} \u00b1 ${number(half, digits)}`;
}

/** `1:05`, `1:02:03`, below a minute `12 s`. @param {number | null | undefined} seconds */
export function duration(seconds) {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return NO_VALUE;
  const whole = Math.max(0, Math.round(seconds));
  if (whole < 60) return `${whole} s`;
  const two = (/** @type {number} */ n) => String(n).padStart(2, "0");
  const [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  return h ? `${h}:${two(m)}:${two(s)} h` : `${m}:${two(s)} min`;
}

/** An age: `0.3 s`, `12 s`, `4 min`, `3 h`, `2 d`. @param {number | null | undefined} seconds */
export function age(seconds) {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return NO_VALUE;
  if (seconds < 0.0995) return `${Math.round(seconds * 1000)} ms`;
  if (seconds < 9.95) return `${seconds.toFixed(1)} s`;
  if (seconds < 100) return `${Math.round(seconds)} s`;
  if (seconds < 6000) return `${Math.round(seconds / 60)} min`;
  return seconds < 172800 ? `${Math.round(seconds / 3600)} h` : `${Math.round(seconds / 86400)} d`;
}

/** Local time of day. @param {number} unix_s @param {number} digits of a second */
export function clock(unix_s, digits = 0) {
  const date = new Date(unix_s * 1000);
  const two = (/** @type {number} */ n) => String(n).padStart(2, "0");
  const text = `${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}`;
  if (digits === 0) return text;
  const rest = unix_s - Math.floor(unix_s);
  return text + Math.min(rest, 0.999999).toFixed(6).slice(1, 2 + digits);
}

/** Units by the end of a name, those of `config/unit_suffixes.py`. @type {Record<string, string>} */
const UNITS = {
  A: "A", mA: "mA", V: "V", W: "W", J: "J", ohm: "\u03a9", Hz: "Hz", C: "\u00b0C",
  s: "s", ms: "ms", us: "\u00b5s", ns: "ns", per_s: "1/s", MB: "MB", ppm: "ppm",
  rad: "rad", rad_s: "rad/s", rad_s2: "rad/s\u00b2", per_rad2: "1/rad\u00b2",
  Nm: "Nm", mNm: "mNm", Nm_per_rad: "Nm/rad", Nm_s_per_rad: "Nm s/rad",
  Nm_per_s: "Nm/s", Nm_per_V: "Nm/V", V_s_per_rad: "V s/rad", V_per_count: "V/count",
  m: "m", kg: "kg", kg_m2: "kg m\u00b2", N_per_m: "N/m",
  K: "K", K_per_W: "K/W", W_per_K: "W/K", J_per_K: "J/K", K_per_min: "K/min",
  K_per_A2: "K/A\u00b2", per_K: "1/K", percent_per_K: "%/K", percent: "%", points: "encoder points", counts: "counts",
};
const SUFFIX = new RegExp(`_(${Object.keys(UNITS).join("|")})$`);

/** A quantity, its unit and its words out of a name like `torque_rate_Nm_per_s`. @param {string} name */
export function nameAndUnit(name) {
  const suffix = SUFFIX.exec(name)?.[1] ?? "";
  const words = (suffix ? name.slice(0, -suffix.length - 1) : name).replaceAll("_", " ");
  return { words, unit: UNITS[suffix] ?? "" };
}

/** The step of 1, 2 or 5 by a power of ten that is next above `step`. @param {number} step */
export function niceStep(step) {
  const power = 10 ** Math.floor(Math.log10(step));
  const times = step / power;
  return (times <= 1.0000001 ? 1 : times <= 2.0000001 ? 2 : times <= 5.0000001 ? 5 : 10) * power;
}

/** Steps of axes: what `decimals` writes of each is the step itself. */
export const STEPS = Array.from({ length: 17 }, (_, k) => [1, 2, 5].map((times) => Number(`${times}e${k - 8}`))).flat();
/** Steps of axes of time: from half a minute on they are whole in minutes, or half of one. */
export const TIME_STEPS_s = [...STEPS.filter((step) => step <= 10), 30, 60, 120, 300, 600, 900, 1800, 3600];
const MINUTES_FROM_S = 120;

/** Decimals that multiples of a step of 1, 2 or 5 by a power of ten have. @param {number} step */
export const decimals = (step) => Math.max(0, Math.min(8, Math.ceil(-Math.log10(step) - 1e-9)));

/** A time before now, on the axis of a window that ends now. @param {number} t_s at most 0 @param {number} step_s between two @param {number} span_s of the window @param {boolean} [old] whether it ends at the last tick, of before */
export function beforeNow(t_s, step_s, span_s, old = false) {
  if (Math.abs(t_s) < step_s / 2) return old ? "last" : "now";
  if (span_s <= MINUTES_FROM_S || step_s < 30) return `${number(t_s, decimals(step_s))} s`;
  return `${number(t_s / 60, step_s < 60 ? 1 : 0)} min`;
}

/**
 * A range of an axis that has `low` and `high` in it and moves seldom: it grows at once, and
 * shrinks when less than 45 % of it is used.
 * @param {number} low
 * @param {number} high
 * @param {Float64Array} range [from, to], changed in place; NaN before the first time
 * @param {number} least the least width
 * @returns {boolean} whether it changed
 */
export function steadyRange(low, high, range, least) {
  if (!(low <= high)) return false;
  const width = Math.max(high - low, least);
  const held = range[1] - range[0];
  if (low >= range[0] && high <= range[1] && width > 0.45 * held) return false;
  const middle = (low + high) / 2;
  const step = niceStep(width / 6);
  const from = Math.floor((middle - 0.56 * width) / step) * step;
  const to = Math.ceil((middle + 0.56 * width) / step) * step;
  if (from === range[0] && to === range[1]) return false;
  range[0] = from;
  range[1] = to;
  return true;
}
