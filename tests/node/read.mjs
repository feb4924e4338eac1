// Reads a recording with @mcap/core, seeking and streaming, and prints what it found as JSON.
import { createHash } from "node:crypto";
import { open, readFile } from "node:fs/promises";
import { McapIndexedReader, McapStreamReader } from "@mcap/core";
import { FileHandleReadable } from "@mcap/nodejs";
import { decompress } from "fzstd";
import protobuf from "protobufjs";
import "protobufjs/ext/descriptor.js";

const decompressHandlers = { zstd: (data, size) => decompress(data, new Uint8Array(Number(size))) };

function tickType(schema) {
  const root = protobuf.Root.fromDescriptor(schema.data);
  return root.lookupType(schema.name);
}

class Account {
  constructor() {
    this.counts = {};
    this.ticks = createHash("sha256");
    this.sums = {};
    this.json = [];
  }

  take(topic, message, type) {
    this.counts[topic] = (this.counts[topic] ?? 0) + 1;
    if (topic === "/tick") {
      this.ticks.update(message.data);
      const tick = type.decode(message.data);
      for (const name of ["tick", "t_ns", "encoder_count", "state"]) {
        this.sums[name] = (this.sums[name] ?? 0n) + BigInt(tick[name].toString());
      }
      this.sums.torque_uNm = (this.sums.torque_uNm ?? 0n) + BigInt(Math.floor(tick.torque_Nm * 1e6));
    } else if (topic !== "/truth") {
      this.json.push(JSON.parse(new TextDecoder().decode(message.data)));
    }
  }

  result() {
    const sums = Object.fromEntries(Object.entries(this.sums).map(([k, v]) => [k, v.toString()]));
    return { counts: this.counts, ticks: this.ticks.digest("hex"), sums, json: this.json };
  }
}

async function seeking(path) {
  const account = new Account();
  const file = await open(path, "r");
  const reader = await McapIndexedReader.Initialize({
    readable: new FileHandleReadable(file),
    decompressHandlers,
  });
  const types = new Map();
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    const channel = reader.channelsById.get(message.channelId);
    if (channel.messageEncoding === "protobuf" && !types.has(channel.id)) {
      types.set(channel.id, tickType(reader.schemasById.get(channel.schemaId)));
    }
    account.take(channel.topic, message, types.get(channel.id));
  }
  const metadata = [];
  for await (const record of reader.readMetadata()) {
    metadata.push(record.name);
  }
  await file.close();
  return { ...account.result(), metadata, statistics: Number(reader.statistics.messageCount) };
}

async function streaming(path) {
  const account = new Account();
  const reader = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  reader.append(await readFile(path));
  const schemas = new Map(), channels = new Map(), types = new Map();
  for (let record; (record = reader.nextRecord()); ) {
    if (record.type === "Schema") {
      schemas.set(record.id, record);
    } else if (record.type === "Channel") {
      channels.set(record.id, record);
    } else if (record.type === "Message") {
      const channel = channels.get(record.channelId);
      if (channel.messageEncoding === "protobuf" && !types.has(channel.id)) {
        types.set(channel.id, tickType(schemas.get(channel.schemaId)));
      }
      account.take(channel.topic, record, types.get(channel.id));
    }
  }
  return { ...account.result(), done: reader.done() };
}

const path = process.argv[2];
console.log(JSON.stringify({ seeking: await seeking(path), streaming: await streaming(path) }));
