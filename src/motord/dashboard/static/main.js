/** The page: puts its parts together. */

import { CalibrationPanel } from "./calibration.js";
import { byId, setText } from "./dom.js";
import { number } from "./format.js";
import { Health } from "./health.js";
import { startKeys } from "./keys.js";
import { Marks } from "./marks.js";
import { Mesh } from "./mesh.js";
import { Messages } from "./messages.js";
import { Notes } from "./notes.js";
import { Operate } from "./operate.js";
import { PlanForm } from "./plan_form.js";
import { PlanProgress } from "./plan.js";
import { PlanQueue } from "./queue.js";
import { takeToken } from "./session.js";
import { Socket } from "./socket.js";
import { Bench } from "./state.js";
import { StatusBar } from "./status_bar.js";
import { StopButton } from "./stop.js";
import { startTabs } from "./tabs.js";
import { startTheme } from "./theme.js";
import { TrackedQuantities } from "./tracking.js";
import { Traces } from "./traces.js";
import { Turns } from "./turns.js";

const TICK_MS = 100;

startTheme(byId("theme"));
const bench = new Bench();
const messages = new Messages();
const marks = new Marks();
const socket = new Socket(takeToken(), receive, (status, message) => bench.setLink(status, message));
const status = new StatusBar(bench, messages);
const stop = new StopButton(bench, socket);
const traces = new Traces(bench, socket, marks);
const notes = new Notes(bench, socket, messages);
const calibration = new CalibrationPanel(bench, socket, messages);
const health = new Health(bench);
new Operate(bench, socket, messages);
new PlanProgress(bench, socket, messages);
new PlanForm(bench, socket, messages);
new PlanQueue(bench, socket, messages);
new Mesh(bench);
new Turns(bench);
new TrackedQuantities(bench);

/** @param {import("./protocol.js").Header} header @param {Float32Array} floats */
function receive(header, floats) {
  if (header.kind === "trace") traces.take(header, floats);
  else bench.take(header, floats);
}

bench.on("hello", (hello) => {
  socket.send({ kind: "visible", value: !document.hidden });
  traces.start(hello.signals, hello.history_s);
});
bench.on("events", (events) => {
  marks.replace(events, bench.epoch_s);
  traces.refresh();
});
bench.on("event", (event) => {
  marks.add(event, bench.epoch_s);
  traces.refresh();
});
bench.on("error", ({ message }) => messages.say("error", `The server ends the connection: ${message}`));
bench.on("state", (state) => {
  const { tick } = state;
  const mean = bench.sensorPassesMean ? "" : " (mean not measured)";
  setText(byId("ripple"), tick?.torque_ripple_Nm != null ? `ripple ${number(1000 * tick.torque_ripple_Nm, bench.torqueDigits - 2)} mNm RMS${mean}` : "");
});

document.addEventListener("visibilitychange", () => {
  socket.send({ kind: "visible", value: !document.hidden });
  if (!document.hidden) {
    status.tick();
    traces.refresh();
  }
});
setInterval(() => {
  if (document.hidden) return;
  status.tick();
  stop.tick();
}, TICK_MS);

startTabs(byId("tabs"), (id) => {
  calibration.setOpen(id === "tab-calibration");
  health.setOpen(id === "tab-health");
});
startKeys(() => stop.stop(), {
  n: () => notes.focus(),
  p: () => traces.togglePause(),
  l: () => byId("plots").focus(),
  "?": () => {
    byId("tab-page").click();
    byId("keys-help").open = true;
    byId("keys-help").scrollIntoView({ block: "nearest" });
  },
});
socket.connect();
