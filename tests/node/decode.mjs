// Decodes payloads of `tick` and `ticks` with tick.proto, read at run time, and prints every field.
//
//   node decode.mjs tick.proto < payloads
//
// stdin: for each payload a letter (t: motord.Tick, b: motord.Ticks), its length (u32, little-endian)
// and its bytes. stdout: a line for each tick, name=value for every field.
import protobuf from "protobufjs";

const root = new protobuf.Root().loadSync(process.argv[2], { keepCase: true });
const tick = root.lookupType("motord.Tick");
const ticks = root.lookupType("motord.Ticks");

export function line(message) {
  return tick.fieldsArray.map((field) => `${field.name}=${message[field.name]}`).join(" ");
}

export function messages(kind, payload) {
  return kind === "t" ? [tick.decode(payload)] : ticks.decode(payload).ticks;
}

async function main() {
  const parts = [];
  for await (const part of process.stdin) {
    parts.push(part);
  }
  const data = Buffer.concat(parts);
  const lines = [];
  for (let at = 0; at < data.length; ) {
    const kind = String.fromCharCode(data[at]);
    const end = at + 5 + data.readUInt32LE(at + 1);
    lines.push(...messages(kind, data.subarray(at + 5, end)).map(line));
    at = end;
  }
  process.stdout.write(lines.join("\n") + "\n");
}

await main();
