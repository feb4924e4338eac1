// Subscribes to `tick` and `ticks` of a daemon over Zenoh and prints every field of so many ticks.
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
    const lines = reader.lines(payload, key.endsWith("/ticks"));
    left -= lines.length;
    process.stdout.write(lines.map((line) => `${key} ${line}\n`).join(""));
    if (left <= 0) subscriber.close();
  },
  Number(batch_size ?? 65535),
);
await subscriber.closed;
