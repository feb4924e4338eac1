// The page's parts that need no browser: `node --test tests/browser`.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

const page = new URL("../../src/motord/dashboard/static/", import.meta.url);
const load = (name) => import(new URL(name, page));
const { decode, encode } = await load("protocol.js");
const { Buckets } = await load("buckets.js");
const { FrameTiming } = await load("frame_timing.js");
const { Raster, rgbOf } = await load("raster.js");
const { TimeWindow } = await load("window.js");
const format = await load("format.js");
const { tokenOf } = await load("session.js");
const { Bench } = await load("state.js");
const { StopTracker } = await load("stop.js");
const { fieldsOf, parse, typeOf } = await load("plan_form.js");
const { grid, shade } = await load("mesh.js");
const { barLength, quantities } = await load("precision.js");
const { troubles } = await load("status_bar.js");
const { largest, spread } = await load("turns.js");
const { Marks } = await load("marks.js");
const { attemptsText, place, policyText, settingsText, timeText, waitText, waitsOf, whole } = await load("queue_items.js");
const overview = await load("bench_texts.js");
const { traceOf } = await load("signals.js");
const { Socket } = await load("socket.js");

test("what an axis says of a tick is where the tick is", () => {
  const { STEPS, TIME_STEPS_s, beforeNow, decimals, number } = format;
  const value = (/** @type {string} */ text) => Number(text.replace("\u2212", "-"));
  for (const step of STEPS) {
    for (const times of [1, 2, 3]) assert.equal(value(number(times * step, decimals(step))), Number((times * step).toPrecision(6)));
  }
  for (const span_s of [0.1, 10, 60, 121, 300, 600, 3600]) {
    for (const step of TIME_STEPS_s.filter((one) => one <= span_s && one >= span_s / 20)) {
      assert.equal(beforeNow(0, step, span_s), "now");
      for (const times of [1, 2, 3]) {
        const [amount, unit] = beforeNow(-times * step, step, span_s).split(" ");
        assert.equal(value(amount) * (unit === "min" ? 60 : 1), Number((-times * step).toPrecision(6)));
      }
    }
  }
});

test("a frame is a length, a padded header and floats", () => {
  const made = encode({ kind: "pong", n: 7 });
  assert.equal(made.length % 4, 0);
  assert.deepEqual(decode(made.buffer), { header: { kind: "pong", n: 7 }, floats: new Float32Array(0) });
  const whole = new Uint8Array(made.length + 8);
  whole.set(made);
  whole.set(new Uint8Array(new Float32Array([1.5, NaN]).buffer), made.length);
  assert.deepEqual([...decode(whole.buffer).floats], [1.5, NaN]);
});

test("what is no frame is refused", () => {
  const bad = [[], [1, 0, 0, 0, 32], [8, 0, 0, 0, 123, 125], [4, 0, 0, 0, 123, 125, 32, 32]];
  for (const bytes of bad) assert.throws(() => decode(new Uint8Array(bytes).buffer));
});

function trace(first, values, whole, dt_s = 0.5) {
  const header = { view: 1, signals: ["x"], live: true, whole, t0_s: first * dt_s, dt_s, buckets: values.length, lost: 0 };
  return [header, new Float32Array([...values, ...values.map((v) => v + 1)])];
}

test("live traces go on from bucket to bucket, in the same arrays", () => {
  const buckets = new Buckets();
  assert.equal(buckets.take(...trace(10, [0, 1, 2, 3], true)), true);
  const [low, high] = buckets.row("x");
  assert.equal(buckets.take(...trace(13, [33, 4], false)), false);
  assert.deepEqual([...low], [1, 2, 33, 4]);
  assert.deepEqual([...high], [2, 3, 34, 5]);
  assert.equal(buckets.row("x")[0], low);
  assert.deepEqual([buckets.t0_s, buckets.end_s], [5.5, 7.5]);
  assert.equal(buckets.version, 1);
});

test("a live frame is measured from the middle of its new samples", async () => {
  const timing = new FrameTiming();
  const observed = new Promise((resolve) => {
    new PerformanceObserver((list) => resolve(list.getEntriesByName("motord.frame"))).observe({ entryTypes: ["measure"] });
  });
  const now_ms = 1e12;
  const epoch_s = now_ms / 1000 - 9;
  timing.take({ whole: true, newest_s: 8.98 });
  timing.drawn(epoch_s, now_ms); // what is whole has old samples
  timing.take({ whole: false, newest_s: 9 });
  timing.drawn(epoch_s, now_ms);
  timing.drawn(epoch_s, now_ms); // nothing new
  const seen = await observed;
  assert.equal(seen.length, 1);
  assert.ok(Math.abs(seen[0].duration - 10) < 0.01, `${seen[0].duration} ms`);
  assert.deepEqual(performance.getEntriesByName("motord.frame"), []);
});

const [WIDTH, HEIGHT, LINE] = [80, 40, 1];
const SCALE = { min: -10, max: 10 };
const INK = rgbOf("rgb(17, 34, 51)");

/** Buckets one pixel wide, of as many as the raster has columns, from bucket `first` on. */
function drawn(values, { first = 0, dash = null, per = 1, raster = new Raster(WIDTH, HEIGHT, LINE), version = 1 } = {}) {
  const low = Float32Array.from(values);
  const high = Float32Array.from(values);
  const grid = { first, count: values.length, dt_s: per, version };
  const columns = raster.draw(grid, [{ low, high, rgb: INK, dash }], first + values.length * per, WIDTH, SCALE);
  return { raster, columns };
}

/** Opacity of the pixels of a column, from the top. */
const column = (raster, x) => Array.from({ length: HEIGHT }, (_, y) => raster.pixels[y * WIDTH + x] >>> 24);

test("a bucket with a spike is drawn up to the spike, its neighbours are not", () => {
  const values = new Array(WIDTH).fill(0);
  values[40] = 9;
  const { raster, columns } = drawn(values);
  assert.equal(columns, WIDTH);
  assert.equal(raster.pixels[20 * WIDTH + 3] & 0xffffff, INK);
  const height = (x) => column(raster, x).filter((alpha) => alpha > 60).length;
  assert.ok(height(40) >= 18, `${height(40)} px`);
  assert.ok(height(37) <= 2 && height(43) <= 2);
  assert.ok(column(raster, 40)[2] > 200);
});

test("a window that moves on looks as if it were drawn anew", () => {
  const at = (i) => 8 * Math.sin(0.37 * i) + (i % 13 === 0 ? 3 : 0);
  for (const step of [0, 1, 3, 79, 80, 200]) {
    const raster = new Raster(WIDTH, HEIGHT, LINE);
    drawn(Array.from({ length: WIDTH }, (_, i) => at(i)), { raster });
    const values = Array.from({ length: WIDTH }, (_, i) => at(i + step));
    const { columns } = drawn(values, { raster, first: step });
    assert.ok(columns <= step + 3, `${columns} columns for ${step}`);
    const whole = drawn(values, { first: step }).raster;
    const kept = step === 0 ? 1 : 2; // the line came from further left; another drawing begins there
    for (let x = kept; x < WIDTH; x++) assert.deepEqual(column(raster, x), column(whole, x), `column ${x} after ${step}`);
  }
});

test("other data, another span or scale are drawn as a whole", () => {
  const { raster } = drawn(new Array(WIDTH).fill(0));
  assert.equal(drawn(new Array(WIDTH).fill(5), { raster, version: 2 }).columns, WIDTH);
  assert.ok(column(raster, 40)[20] === 0 && column(raster, 40)[10] > 100);
});

test("between the outlines is a shade, in a gap nothing", () => {
  const raster = new Raster(WIDTH, HEIGHT, LINE);
  const low = new Float32Array(WIDTH).fill(-5);
  const high = new Float32Array(WIDTH).fill(5);
  low.fill(NaN, 30, 50);
  high.fill(NaN, 30, 50);
  raster.draw({ first: 0, count: WIDTH, dt_s: 1, version: 1 }, [{ low, high, rgb: INK, dash: null }], WIDTH, WIDTH, SCALE);
  assert.deepEqual(column(raster, 40), new Array(HEIGHT).fill(0));
  assert.equal(column(raster, 10)[20], Math.round(0.3 * 255));
  assert.deepEqual([column(raster, 10)[4], column(raster, 10)[35]], [0, 0]);
});

test("wide buckets are joined by lines; a dashed step is whole", () => {
  const { raster } = drawn(new Array(WIDTH / 8).fill(0).map((_, i) => i), { per: 8 });
  for (let x = 0; x < WIDTH; x++) assert.ok(Math.max(...column(raster, x)) > 100, `column ${x}`);
  for (let step = 20; step < 30; step++) {
    const values = Array.from({ length: WIDTH }, (_, i) => (i < step ? -8 : 8));
    const dashed = drawn(values, { dash: [6, 4] }).raster;
    const inked = [step - 1, step].map((x) => column(dashed, x).filter((alpha) => alpha > 100).length);
    assert.ok(Math.max(...inked) > 12, `${inked} px at ${step}`);
  }
});

test("what lies over another is mixed, and stays opaque where it was", () => {
  const raster = new Raster(WIDTH, HEIGHT, LINE);
  const flat = (value) => new Float32Array(WIDTH).fill(value);
  const bands = [
    { low: flat(0.25), high: flat(0.25), rgb: rgbOf("rgb(200, 0, 0)"), dash: null },
    { low: flat(-5), high: flat(5), rgb: rgbOf("rgb(0, 0, 200)"), dash: null },
  ];
  raster.draw({ first: 0, count: WIDTH, dt_s: 1, version: 1 }, bands, WIDTH, WIDTH, SCALE);
  assert.equal(raster.pixels[19 * WIDTH + 9] >>> 0, ((255 << 24) | rgbOf("rgb(140, 0, 60)")) >>> 0);
});

test("buckets that were skipped have no ticks", () => {
  const buckets = new Buckets();
  buckets.take(...trace(0, [0, 1, 2, 3], true));
  buckets.take(...trace(6, [6], false));
  assert.deepEqual([...buckets.row("x")[0]], [3, NaN, NaN, 6]);
  buckets.take(...trace(100, [7, 8], false));
  assert.deepEqual([...buckets.row("x")[0]], [NaN, NaN, 7, 8]);
  assert.equal(buckets.at(50.2), 2);
  assert.equal(buckets.at(48.2), -1);
});

test("more than fits, and another width, do no harm", () => {
  const buckets = new Buckets();
  buckets.take(...trace(0, [0, 1], true));
  buckets.take(...trace(1, [1, 2, 3, 4, 5], false));
  assert.deepEqual([...buckets.row("x")[0]], [4, 5]);
  assert.equal(buckets.take(...trace(9, [9], false, 0.25)), false);
  assert.deepEqual([...buckets.row("x")[0]], [4, 5]);
  assert.throws(() => buckets.take(trace(0, [0], true)[0], new Float32Array(3)));
});

test("the extent of a signal has its spikes and no gaps", () => {
  const buckets = new Buckets();
  buckets.take(...trace(0, [0, NaN, 80, 1], true));
  const range = new Float64Array([Infinity, -Infinity]);
  buckets.extend("x", range);
  buckets.extend("unknown", range);
  assert.deepEqual([...range], [0, 81]);
  assert.equal(buckets.newest("x"), 3);
});

test("a window is held, zoomed about a time, moved, and live again", () => {
  const window = new TimeWindow(10, 600);
  window.zoom(-1);
  assert.deepEqual([window.live, window.span_s], [true, 5]);
  window.pause(100);
  window.zoom(-1, 99);
  assert.deepEqual([window.span_s, window.end_s], [2.5, 99.5]);
  window.pan(-1, 100);
  assert.equal(window.end_s, 97);
  window.pan(1000, 100);
  assert.equal(window.end_s, 100);
  window.pan(-1000, 1000);
  assert.equal(window.end_s, 1000 - 600 + 2.5);
  window.select(3, 4);
  assert.deepEqual([window.span_s, window.end_s], [1, 4]);
  window.resume();
  assert.equal(window.live, true);
  for (let i = 0; i < 20; i++) window.zoom(1);
  assert.equal(window.span_s, 600);
});

test("numbers, times and ages as an instrument shows them", () => {
  assert.equal(format.number(-0.0004, 2), "0.00");
  assert.equal(format.number(-1.5, 1), "\u22121.5");
  assert.equal(format.number(null, 1), "\u2013");
  assert.equal(format.plusMinus(1.02134, 0.0042), "1.0213 \u00b1 0.0042");
  assert.equal(format.plusMinus(-12.3, 1.0), "\u221212.3 \u00b1 1.0");
  assert.equal(format.plusMinus(1234.5, 123), "1235 \u00b1 123");
  assert.equal(format.plusMinus(1.5, 0), "1.500");
  assert.equal(format.commonDigits([0.24, 0.19, null], 1), 1);
  assert.equal(format.commonDigits([0.00003, 0.00025], 1), 5);
  assert.equal(format.commonDigits([null], 3), 3);
  assert.equal(format.significant(0.01234), "0.0123");
  assert.equal(format.significant(1234), "1234");
  assert.equal(format.duration(59.4), "59 s");
  assert.equal(format.duration(65), "1:05 min");
  assert.equal(format.duration(3725), "1:02:05 h");
  assert.equal(format.age(0.0421), "42 ms");
  assert.equal(format.age(240), "4 min");
  assert.deepEqual(format.nameAndUnit("torque_rate_Nm_per_s"), { words: "torque rate", unit: "Nm/s" });
  assert.deepEqual(format.nameAndUnit("turns"), { words: "turns", unit: "" });
  assert.deepEqual(format.nameAndUnit("steady_K_per_min"), { words: "steady", unit: "K/min" });
});

test("torques are set and written as finely as the motor is small", () => {
  const bench = new Bench();
  for (const [torque_Nm, step_Nm, digits] of [[6, 0.05, 2], [0.03, 0.0002, 4], [500, 5, 2]]) {
    bench.take({ kind: "hello", epoch_ns: 0, limits: { torque_Nm } });
    assert.ok(Math.abs(bench.torqueStep_Nm / step_Nm - 1) < 1e-9);
    assert.equal(bench.torqueDigits, digits);
  }
});

test("every unit that a name of the bench file ends with is known", () => {
  const source = readFileSync(new URL("../../src/motord/config/unit_suffixes.py", import.meta.url), "utf8");
  const suffixes = [...source.matchAll(/"(\w+)": "/g)].map(([, suffix]) => suffix);
  assert.ok(suffixes.length > 30);
  for (const suffix of suffixes) {
    const { words, unit } = format.nameAndUnit(`some_${suffix}`);
    assert.equal(words, "some", suffix);
    assert.notEqual(unit, "", suffix);
  }
});

test("a quantity of a trip has its unit after the numbers", () => {
  const cases = JSON.parse(readFileSync(new URL("../support/quantity_texts.json", import.meta.url), "utf8"));
  for (const { quantity, value, limit, text } of cases) assert.equal(format.quantityText(quantity, value, limit), text);
});

test("an axis grows at once and shrinks seldom", () => {
  const range = new Float64Array([NaN, NaN]);
  assert.equal(format.steadyRange(0, 1, range, 0.1), true);
  assert.ok(range[0] <= 0 && range[1] >= 1);
  assert.equal(format.steadyRange(0.1, 0.9, range, 0.1), false);
  assert.equal(format.steadyRange(0, 8, range, 0.1), true);
  assert.ok(range[1] >= 8);
  assert.equal(format.steadyRange(0, 1, range, 0.1), true);
  assert.ok(range[1] < 3);
  assert.equal(format.steadyRange(Infinity, -Infinity, range, 0.1), false);
});

test("the token leaves the address", () => {
  const token = "A-b_3".repeat(8);
  for (const tail of [`#token=${token}`, `#${token}`, `?token=${token}`]) {
    assert.deepEqual(tokenOf(`http://127.0.0.1:8447/${tail}`), { token, clean: "http://127.0.0.1:8447/" });
  }
  assert.equal(tokenOf("http://127.0.0.1:8447/#plots").token, "");
});

test("stopped is what the daemon reported, and nothing else", () => {
  const stop = new StopTracker();
  stop.reported("OFF");
  stop.asked(0, true);
  assert.equal(stop.status, "stopping");
  stop.replied();
  assert.equal(stop.status, "stopping");
  stop.reported("ENABLED");
  assert.equal(stop.status, "stopping");
  stop.tick(2);
  assert.equal(stop.status, "unconfirmed");
  stop.reported("OFF");
  assert.equal(stop.status, "stopped");
  stop.asked(10, false);
  stop.reported("OFF");
  assert.equal(stop.status, "not sent");
  stop.asked(20, true);
  stop.reported("OFF");
  stop.failed("no answer in time");
  assert.equal(stop.status, "not sent");
});

test("each state after the stop is said, and the last one long enough to be read", () => {
  const stop = new StopTracker();
  stop.asked(0, true);
  stop.replied();
  stop.tick(60);
  stop.reported("READY");
  assert.match(stop.message, /reports READY/);
  stop.tick(61);
  stop.reported("OFF");
  assert.match(stop.message, /reports OFF/);
  for (const [now_s, status] of [[66, "stopped"], [71, "stopped"], [73, "idle"]]) {
    stop.tick(Number(now_s));
    stop.reported("OFF");
    assert.equal(stop.status, status);
  }
});

test("settings are checked before they are sent", () => {
  const [torques, turns, stator] = fieldsOf({ settings: {}, fields: [
    { name: "torques_Nm", type: "list", default: [1, 2], length_min: 1 },
    { name: "turns", type: "integer", default: 24, minimum: 2 },
    { name: "stator", type: "boolean", default: false },
  ] });
  assert.deepEqual(parse(torques, "1, 2.5  \u22123"), [1, 2.5, -3]);
  assert.throws(() => parse(torques, "1, x"), /torques: "x" is no number/);
  assert.throws(() => parse(turns, "1"), /turns: at least 2/);
  assert.throws(() => parse(turns, "2.5"), /whole number/);
  assert.deepEqual([torques.unit, stator.type, typeOf(null), typeOf([{}])], ["Nm", "boolean", "number", "other"]);
  assert.throws(() => parse(torques, ""), /at least 1 values/);
  assert.throws(() => parse({ ...turns, minimum_excluded: true }, "2"), /more than 2/);
  assert.equal(parse({ ...turns, optional: true }, " "), null);
  assert.equal(fieldsOf({ settings: { turns: 24 } })[0].type, "number");
});

test("a mesh has rows of torque, the largest on top, and keeps what was measured", () => {
  const point = (torque_Nm, speed_Hz, error) => ({ torque_Nm, speed_Hz, rms_error_percent: error });
  const made = grid([point(1, 0.5, 2), point(2, 0.6, null), point(1, 0.5, null), point(1, 0.6, 3)], false);
  assert.deepEqual([made.torques, made.speeds], [[2, 1], [0.5, 0.6]]);
  assert.equal(made.at(1, 0.5).rms_error_percent, 2);
  assert.equal(made.at(2, 0.5), undefined);
});

test("a mesh goes by magnitude where the daemon says so, its points with induced errors only where there is no other", () => {
  const point = (torque_Nm, speed_Hz, error, induced = {}) => ({ torque_Nm, speed_Hz, rms_error_percent: error, induced });
  const scaled = { gain: [0.8, 1, 1] };
  const points = [point(1, 0.5, 2), point(2, 0.6, 4), point(-1, -0.6, 3), point(-2, -0.5, null), point(2, 0.5, 9, scaled)];
  const made = grid(points, true);
  assert.deepEqual([made.torques, made.speeds], [[2, 1], [0.5, 0.6]]);
  assert.equal(made.at(1, 0.6).rms_error_percent, 3);
  assert.equal(made.at(2, 0.5).speed_Hz, -0.5);
  const signed = grid(points, false);
  assert.deepEqual([signed.torques, signed.speeds], [[2, 1, -1, -2], [-0.6, -0.5, 0.5, 0.6]]);
});

test("a quantity is reached from its target on; what is not known yet fills its bar", () => {
  const plan = { targets: { alpha_percent: 0.1, beta_A: 0.02, cogging_percent: 1 }, precision: { alpha_percent: 0.1, beta_A: 0.0201 } };
  const shown = quantities(plan);
  assert.deepEqual(shown.map(({ words, unit, half, reached }) => [words, unit, half, reached]),
    [["alpha", "%", 0.1, true], ["beta", "A", 0.0201, false], ["cogging", "%", null, false]]);
  assert.equal(barLength(shown[0]), barLength({ half: 4, target: 4 }));
  assert.equal(barLength({ half: 2, target: 4 }), barLength(shown[0]) / 2);
  assert.equal(barLength({ half: 1e3, target: 1 }), barLength(shown[2]));
  assert.deepEqual(quantities({}), []);
});

test("text on the mesh has contrast", () => {
  for (let share = 0; share <= 1; share += 0.01) {
    const { rgb, light } = shade(share);
    const linear = rgb.match(/\d+/g).map((c) => (c / 255 <= 0.04045 ? c / 255 / 12.92 : ((c / 255 + 0.055) / 1.055) ** 2.4));
    const luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
    assert.ok((light ? 1.05 / (luminance + 0.05) : (luminance + 0.05) / 0.05) >= 4.5, `${share}: ${rgb}`);
  }
});

test("a turn in which the set-point moved says so, in place of a set-point", () => {
  const plain = (steady, mean) => spread(1.404, { set_Nm: 2.567, steady }, mean).replaceAll("\u00a0", " ");
  assert.equal(plain(true, true), "1.40 Nm p-p about 2.57 Nm");
  assert.equal(plain(true, false), "1.40 Nm p-p at 2.57 Nm (no mean)");
  assert.equal(plain(false, true), "1.40 Nm p-p as the set-point moved");
});

test("an axis that ends at the last tick, of before, does not say now", () => {
  assert.equal(format.beforeNow(0, 2, 10, true), "last");
  assert.equal(format.beforeNow(-2, 2, 10, true), format.beforeNow(-2, 2, 10));
});

test("what is wrong with recording, processes and parts of the daemon; the loop's end once", () => {
  const process = { running: true, exit: "" };
  const state = { fault: "", recording: { error: "" }, processes: { loop: process, recorder: process }, faults: {} };
  assert.deepEqual(troubles(state), []);
  const ended = { running: false, exit: "exit code 1" };
  assert.deepEqual(troubles({ ...state, fault: "the loop ended", processes: { loop: ended, recorder: process } }), []);
  assert.deepEqual(troubles({ ...state, recording: { error: "disk full" }, processes: { loop: process, recorder: ended }, faults: { queue: "no file" } }),
    ["Recording: disk full", "The process recorder does not run: exit code 1", "Fault in queue: no file"]);
});

test("a bench is enabled where nothing is in the way, and what is has a name", () => {
  const bench = new Bench();
  const why = (changes, plan = null) => {
    const state = { state: "OFF", fault: "", remedy: "", trips: [], plan, ...changes };
    bench.take({ kind: "state", data: state }, new Float32Array(0));
    return bench.enableObstacle;
  };
  const trips = [{ name: "BUS_VOLTAGE", meaning: "no bus voltage" }, { name: "ENCODER", meaning: "no encoder" }];
  assert.equal(why({}), "");
  assert.equal(why({ state: "READY" }), "");
  assert.equal(why({ state: "TRIPPED", trips }), "Reset it first.");
  assert.equal(why({ trips }), "It cannot be enabled: no bus voltage; no encoder."); // after a reset
  assert.equal(why({ state: "READY", fault: "the loop hangs", remedy: "reset" }), "Reset it first.");
  assert.equal(why({ state: "READY" }, { state: "paused" }), "A plan is under way.");
  assert.equal(why({ state: "ENABLED" }), "It is enabled.");
});

test("a state that the server has kept is as old as the server says", () => {
  const bench = new Bench();
  const none = new Float32Array(0);
  bench.take({ kind: "state", data: { state: "OFF", plan: null } }, none);
  assert.ok(bench.age_s < 60);
  bench.take({ kind: "connection", alive: false, age_s: 3600, message: "gone" }, none);
  assert.ok(bench.age_s >= 3600);
  bench.take({ kind: "state", data: { state: "OFF", plan: null } }, none);
  bench.take({ kind: "connection", alive: true, age_s: 0.1, message: "" }, none);
  assert.ok(bench.age_s < 60);
});

test("the largest orders, without the mean and what is small", () => {
  const amplitude = [5, 0.1, NaN, 1, 0.5, 0.2];
  assert.deepEqual(largest(6, (order) => amplitude[order], 4), [3, 4]);
});

test("marks are kept in time and found near it", () => {
  const marks = new Marks();
  marks.replace([{ t_ns: 12e9, kind: "note", message: "warm" }, { t_ns: 13e9, kind: "request", message: "set" }], 10);
  assert.deepEqual(marks.all.map((mark) => mark.t_s), [2]);
  assert.equal(marks.near(2.1, 0.2).text, "warm");
  assert.equal(marks.near(3, 0.2), null);
});

test("phases and set-points differ by more than colour", () => {
  const signal = (name) => traceOf({ name, label: "phase", unit: "A", group: "current" }, 0);
  assert.deepEqual(["i_a_A", "i_b_A", "i_cmd_a_A"].map((name) => signal(name).tag), ["a", "b", "a*"]);
  assert.notEqual(signal("i_cmd_a_A").dash, undefined);
  assert.notEqual(signal("torque_set_Nm").dash, undefined);
});

test("an item of the queue in words", () => {
  const wait = { channel: "winding_C", below: 40, above: null, until: null, limit_s: 90 };
  assert.equal(waitText(wait), "winding_C below 40, at most 1:30 min");
  assert.equal(waitText({ ...wait, channel: null, until: "06:00", limit_s: null }), "until 06:00");
  assert.equal(waitText({ channel: "oil_bar", above: 1.5 }), "oil_bar above 1.5");
  assert.equal(policyText(whole({ name: "cogging" })), "if it fails: the queue pauses");
  assert.equal(settingsText({ torques_Nm: [1, 2], turns: 2, stator: null, gain_steps: [] }), "torques 1, 2 Nm \u00b7 turns 2 \u00b7 stator none \u00b7 gain steps none");
  assert.ok(settingsText({ table: [{ a: "x".repeat(1000) }] }).length < 80);
  assert.deepEqual(["stop", "skip", "retry"].map((on_failure) => policyText({ on_failure, retries: 2 })),
    ["if it fails: the queue pauses", "if it fails: skipped", "if it fails: again, at most 2 times"]);
  const runs = [{ id: 1, state: "failed", message: "too slow", ended_ns: 0 }, { id: 2, state: "done", ended_ns: 0 }];
  assert.match(attemptsText({ id: 1 }, [...runs, runs[0]]), /^2 attempts; failed at \d\d:\d\d:\d\d: too slow$/);
  assert.equal(attemptsText({ id: 3 }, runs), "");
  const item = { state: "running", estimate_s: 96 };
  assert.equal(timeText(item, { state: "running", eta_s: 30 }), "30 s to go");
  assert.equal(timeText(item, { state: "done", eta_s: 0 }), "about 1:36 min");
  assert.equal(timeText({ ...item, state: "queued" }, { state: "running", eta_s: 30 }), "about 1:36 min");
});

test("items move among those that are not under way", () => {
  const items = [{ id: 7, state: "running" }, { id: 3, state: "queued" }, { id: 9, state: "queued" }, { id: 5, state: "queued" }];
  assert.deepEqual([3, 9, 5].map((id) => place(items, id, -1)), [null, 1, 2]);
  assert.deepEqual([3, 9, 5].map((id) => place(items, id, 1)), [2, 3, null]);
  assert.deepEqual([place(items, 7, 1), place(items, 1, 1)], [null, null]);
});

test("a bench of the overview in words", () => {
  const state = { t_ns: 0, state: "TRIPPED", first_trip: "B", trips: [{ name: "A", meaning: "a" }, { name: "B", meaning: "b" }], action: "look", fault: "",
    plan: { plan: "calibrate", state: "running", serial: "7", points: 8, points_done: 2, fraction: 0.25, eta_s: 90, message: "" },
    torque_Nm: 1.98, torque_set_Nm: 2, speed_Hz: 0.7, mean_measured: true, recording: false, recording_name: "", recording_trouble: "disk full" };
  const bench = { bench: "a", silent: false, age_s: 0.2, daemons: 1, problem: "", gone_ns: null, state };
  const silent = { ...bench, silent: true, age_s: 42 };
  const gone = { ...bench, gone_ns: 1 };
  assert.equal(overview.summary([bench, silent, gone]), "2 benches: 1 tripped, 1 with a plan, 1 silent; 1 vanished");
  assert.equal(overview.summary([]), "0 benches");
  assert.deepEqual([bench, silent, gone].map(overview.old), [false, true, true]);
  assert.equal(overview.ageText(bench, 1), "1.2 s old");
  assert.equal(overview.ageText(silent, 1), "silent for 43 s");
  assert.match(overview.ageText(gone, 0), /^vanished at \d\d:\d\d:\d\d/);
  assert.equal(overview.ageText({ ...silent, age_s: null, state: null }, 0), "silent: no answer");
  assert.deepEqual(overview.troubles(state), ["B: b", "A: a", "What to do: look; then reset"]);
  assert.deepEqual(overview.troubles({ ...state, state: "OFF", fault: "no loop" }), ["no loop"]);
  assert.deepEqual(overview.troubles({ ...state, state: "OFF", fault: "no loop", remedy: "reset" }), ["no loop", "What to do: reset"]);
  assert.equal(overview.planText(state.plan), "calibrate \u25b6 running, serial 7 \u00b7 2 of 8 points \u00b7 25 %, 1:30 min to go");
  assert.match(overview.planText({ ...state.plan, state: "failed", message: "too slow" }), /2 of 8 points \u00b7 too slow$/);
  assert.equal(overview.motionText(state), "1.98 of 2.00 Nm set \u00b7 0.70 Hz");
  assert.equal(overview.motionText({ ...state, torque_Nm: 0, torque_set_Nm: 0.0125 }), "0 of 0.0125 Nm set \u00b7 0.70 Hz");
  assert.equal(overview.motionText({ ...state, mean_measured: false }), "2.00 Nm set \u00b7 0.70 Hz");
  assert.equal(overview.recorderText(state), "not recording: disk full");
  assert.equal(overview.recorderText({ ...state, recording: true, recording_name: "a.mcap" }), "\u25cf a.mcap: disk full");
  assert.equal(overview.queueText({ state: "paused", length: 2, eta_s: 60 }), "\u275a\u275a paused \u00b7 2 plans, about 1:00 min");
});

test("of two attempts to connect at the same time one socket is left", async (t) => {
  const [made, listeners, answers] = [[], {}, []];
  const globals = {
    WebSocket: class {
      static OPEN = 1;
      constructor() {
        made.push(this);
      }
      close() {}
    },
    addEventListener: (kind, listener) => (listeners[kind] = listener),
    fetch: () => new Promise((resolve) => answers.push(() => resolve({ ok: true }))),
    location: { href: "http://127.0.0.1:8447/" },
    setInterval: () => 0,
  };
  for (const [name, value] of Object.entries(globals)) {
    const before = Object.getOwnPropertyDescriptor(globalThis, name);
    Object.defineProperty(globalThis, name, { value, configurable: true, writable: true });
    t.after(() => (before ? Object.defineProperty(globalThis, name, before) : delete globalThis[name]));
  }
  const kinds = [];
  const socket = new Socket("token", (header) => kinds.push(header.kind), () => {});
  const attempts = [socket.connect(), listeners.online()];
  for (const answer of answers) answer();
  await Promise.all(attempts);
  await new Promise((resolve) => setImmediate(resolve));
  assert.equal(made.length, 1);
  made[0].onmessage({ data: encode({ kind: "state" }).buffer });
  socket._closed(made[0], "");
  made[0].onmessage({ data: encode({ kind: "plan" }).buffer });
  clearTimeout(socket._timer);
  assert.deepEqual(kinds, ["state"]);
});

test("waits of the queue as they are entered", () => {
  assert.deepEqual(waitsOf(" "), []);
  assert.deepEqual(waitsOf("Until 06:00;  winding_C Below \u22125.5 ; humidity above 0"), [
    { until: "06:00" }, { channel: "winding_C", below: -5.5 }, { channel: "humidity", above: 0 },
  ]);
  assert.deepEqual(waitsOf("until 06:00; a below 1;", 90), [{ until: "06:00", limit_s: 90 }, { channel: "a", below: 1, limit_s: 90 }]);
  for (const wrong of ["06:00", "winding below", "winding below x", "winding < 40", "until", "a below 1 until 06:00"]) {
    assert.throws(() => waitsOf(`until 06:00; ${wrong}`), (/** @type {Error} */ error) => error.message.startsWith(`"${wrong}" is no wait: `));
  }
  for (const one of waitsOf("until 06:00; winding_C below 40", 60)) assert.deepEqual(waitsOf(waitText(one).replace(/,.*/, ""), 60), [one]);
});

test("a control that is not allowed yet gets the focus once it is, unless the person went on", async (t) => {
  const { allow, focusOnceAllowed } = await load("dom.js");
  const inputs = new EventTarget();
  const documents = { activeElement: null, addEventListener: inputs.addEventListener.bind(inputs) };
  const before = Object.getOwnPropertyDescriptor(globalThis, "document");
  Object.defineProperty(globalThis, "document", { value: documents, configurable: true });
  t.after(() => (before ? Object.defineProperty(globalThis, "document", before) : delete globalThis.document));
  const stub = (id, disabled) => {
    const made = { id, disabled, dataset: {}, focus: () => (documents.activeElement = made), hasAttribute: () => false, getAttribute: () => null, setAttribute: () => {} };
    return made;
  };
  const focused = (act) => {
    const [start, other, list] = [stub("start", true), stub("other", true), stub("list", false)];
    focusOnceAllowed(start, list);
    assert.equal(documents.activeElement, list);
    act({ start, other, list });
    return documents.activeElement?.id;
  };
  assert.equal(focused(({ start }) => allow(start, "")), "start");
  assert.equal(focused(({ start }) => allow(start, "the bench is enabled")), "list");
  assert.equal(focused(({ other }) => allow(other, "")), "list");
  assert.equal(focused(({ start, other }) => [allow(other, ""), allow(start, "wait"), allow(start, "")]), "start");
  // made anew meanwhile, as the list is: its id says which it is
  assert.equal(focused(() => allow(stub("start", true), "")), "start");
  for (const kind of ["keydown", "pointerdown"]) {
    assert.equal(focused(({ start }) => [inputs.dispatchEvent(new Event(kind)), allow(start, "")]), "list");
  }
  assert.equal(focused(({ start, other }) => [other.focus(), allow(start, "")]), "other");
  // and once only
  assert.equal(focused(({ start, list }) => [allow(start, ""), list.focus(), allow(start, "wait"), allow(start, "")]), "list");
  assert.equal(focused(({ start, list }) => [focusOnceAllowed(stub("other", false), list), allow(start, "")]), "other");
});
