// Decodes payloads of `tick` and `ticks` with tick.proto, and prints every field.
//
//   node decode.mjs tick.proto < payloads
//
// stdin: for each payload a letter (t: motord.Tick, b: motord.Ticks), its length (u32, little-endian)
// and its bytes. stdout: a line for each tick, name=value for every field.
import { TickReader } from "./ticks.mjs";

const reader = new TickReader(process.argv[2]);
const parts = [];
for await (const part of process.stdin) {
  parts.push(part);
}
const data = Buffer.concat(parts);
const lines = [];
for (let at = 0; at < data.length; ) {
  const end = at + 5 + data.readUInt32LE(at + 1);
  lines.push(...reader.lines(data.subarray(at + 5, end), data[at] === "b".charCodeAt(0)));
  at = end;
}
process.stdout.write(lines.join("\n") + "\n");
