// Subscribes to `tick` and `ticks` of a daemon over Zenoh and prints every field of what comes, until
// COUNT ticks have come in blocks.
//
//   node subscribe.mjs HOST PORT BENCH tick.proto COUNT [BATCH_SIZE]
import { TickReader } from "./ticks.mjs";
import { Subscriber } from "./zenoh.mjs";

const [host, port, bench, proto, count, batch_size] = process.argv.slice(2);
const reader = new TickReader(proto);
let left = Number(count);

const subscriber = new Subscriber(
  host,
  Number(port),
  `motord/${bench}/tick$*`,
  (key, payload) => {
    if (left <= 0) return;
    const block = key.endsWith("/ticks");
    const lines = reader.lines(payload, block);
    if (block) left -= lines.length;
    process.stdout.write(lines.map((line) => `${key} ${line}\n`).join(""));
    if (left <= 0) subscriber.close();
  },
  Number(batch_size ?? 65535),
);
await subscriber.closed;
