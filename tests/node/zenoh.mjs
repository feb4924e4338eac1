// A subscriber of Zenoh in client mode over TCP: as much of the protocol (version 9) as that takes.
//
// A link carries batches, each after its length (u16, little-endian). A batch holds transport
// messages; a FRAME holds network messages up to its end, FRAGMENTs one network message in parts.
// Each priority has frames and fragments of its own. Numbers are variable-length, as in protobuf.
//
// A client has to agree on priorities (QOS): routers up to Zenoh 1.10 never send one that does not
// anything more once they have dropped a message for it.
import { randomBytes } from "node:crypto";
import { connect } from "node:net";

const VERSION = 9;
const CLIENT = 2;
const RESOLUTION_32_BIT = 0b1010; // of frames' sequence numbers and of request ids
const LEASE_S = 10;
const [INIT, OPEN, CLOSE, KEEP_ALIVE, FRAME, FRAGMENT] = [1, 2, 3, 4, 5, 6];
const [INTEREST, RESPONSE_FINAL, PUSH, DECLARE, OAM] = [0x19, 0x1a, 0x1d, 0x1e, 0x1f];
const [DECLARE_KEY, UNDECLARE_KEY, DECLARE_SUBSCRIBER, DECLARE_FINAL] = [0, 1, 2, 0x1a];
const PUT = 1;
const EXTENSIONS = 0x80; // flag Z of every header
const [QOS, PATCH] = [1, 7]; // extensions of INIT; QOS is of frames and fragments, too
const [FIRST, DROP] = [2, 3]; // of fragments, agreed on by PATCH
const DATA = 5; // the priority that is not written
const [FLAG_5, FLAG_6] = [0x20, 0x40]; // their meaning is each message's own

class Reader {
  constructor(data) {
    this.data = data;
    this.at = 0;
  }
  get empty() {
    return this.at >= this.data.length;
  }
  byte() {
    if (this.empty) throw new Error("a message is cut off");
    return this.data[this.at++];
  }
  bytes(length) {
    if (this.at + length > this.data.length) throw new Error("a message is cut off");
    this.at += length;
    return this.data.subarray(this.at - length, this.at);
  }
  rest() {
    return this.bytes(this.data.length - this.at);
  }
  number() {
    let value = 0n;
    for (let shift = 0n; ; shift += 7n) {
      const byte = this.byte();
      value |= BigInt(byte & 0x7f) << shift;
      if (byte < 0x80 || shift === 56n) return Number(value);
    }
  }
  slice() {
    return this.bytes(this.number());
  }
  // Return the extensions of a message by id: a number, bytes, or true.
  extensions(header) {
    const found = new Map();
    for (let more = header & EXTENSIONS; more; ) {
      const own = this.byte();
      found.set(own & 0x0f, this.body(own));
      more = own & EXTENSIONS;
    }
    return found;
  }
  body(header) {
    if ((header & 0x60) === 0x20) return this.number();
    if ((header & 0x60) === 0x40) return this.slice();
    return true;
  }
}

function number(value) {
  const out = [];
  for (; value > 0x7f; value = Math.floor(value / 128)) out.push((value % 128) | 0x80);
  return Buffer.from([...out, value]);
}

const slice = (data) => Buffer.concat([number(data.length), data]);

export class Subscriber {
  // `received` is called with key and payload of each message; `batch_size` is what we take.
  constructor(host, port, key, received, batch_size = 65535) {
    this.key = key;
    this.received = received;
    this.keys = new Map(); // that the router has declared, by number
    this.parts = new Map(); // of the fragmented message of each priority, from its first on
    this.pending = Buffer.alloc(0);
    this.socket = connect(port, host, () => this.send(this.init(batch_size)));
    this.socket.on("data", (data) => this.take(data));
    this.closed = new Promise((resolve, reject) => {
      this.socket.on("close", resolve);
      this.socket.on("error", reject);
    });
  }

  close() {
    clearInterval(this.timer);
    this.send(Buffer.from([CLOSE | FLAG_5, 0]));
    this.socket.end();
  }

  send(message) {
    const head = Buffer.alloc(2);
    head.writeUInt16LE(message.length);
    this.socket.write(Buffer.concat([head, message]));
  }

  init(batch_size) {
    const zid = randomBytes(16);
    zid[15] |= 1; // an id does not end with zeros
    const head = Buffer.from([INIT | FLAG_6 | EXTENSIONS, VERSION, CLIENT | (15 << 4)]);
    const sizes = Buffer.from([RESOLUTION_32_BIT, batch_size & 0xff, batch_size >> 8]);
    return Buffer.concat([head, zid, sizes, Buffer.from([QOS | EXTENSIONS, PATCH | 0x20, 1])]);
  }

  take(data) {
    this.pending = Buffer.concat([this.pending, data]);
    while (this.pending.length >= 2) {
      const end = 2 + this.pending.readUInt16LE(0);
      if (this.pending.length < end) return;
      const batch = new Reader(this.pending.subarray(2, end));
      this.pending = this.pending.subarray(end);
      while (!batch.empty) this.transport(batch);
    }
  }

  transport(reader) {
    const header = reader.byte();
    switch (header & 0x1f) {
      case INIT:
        return this.opened(reader, header);
      case OPEN: {
        reader.number(); // lease
        reader.number(); // first sequence number
        reader.extensions(header);
        this.timer = setInterval(() => this.send(Buffer.from([KEEP_ALIVE])), (LEASE_S * 1000) / 4);
        return this.send(this.subscription());
      }
      case CLOSE:
        throw new Error(`the router closed the session, reason ${reader.byte()}`);
      case KEEP_ALIVE:
        return reader.extensions(header);
      case FRAME:
        reader.number(); // sequence number
        reader.extensions(header);
        while (!reader.empty) this.network(reader);
        return undefined;
      case FRAGMENT: {
        reader.number(); // sequence number
        const marks = reader.extensions(header);
        const whole = this.assembled(marks, Buffer.from(reader.rest()), !(header & FLAG_6));
        return whole && this.network(new Reader(whole));
      }
      default:
        throw new Error(`transport message ${header & 0x1f}`);
    }
  }

  // Return the message that a fragment completes, if it does.
  assembled(marks, part, last) {
    const priority = (marks.get(QOS) ?? DATA) & 7;
    if (marks.has(FIRST)) this.parts.set(priority, []);
    if (marks.has(DROP)) this.parts.delete(priority); // the router gave the rest of it up
    const parts = this.parts.get(priority);
    parts?.push(part);
    if (!last || !parts) return undefined;
    this.parts.delete(priority);
    return Buffer.concat(parts);
  }

  opened(reader, header) {
    reader.byte(); // version
    reader.bytes(1 + (reader.byte() >> 4)); // id of the router
    if (header & FLAG_6) reader.bytes(3); // sizes
    const cookie = reader.slice();
    const agreed = reader.extensions(header);
    if (!agreed.has(PATCH)) throw new Error("a router older than Zenoh 1.1");
    if (!agreed.has(QOS)) throw new Error("a router without priorities (transport/unicast/qos)");
    const open = [Buffer.from([OPEN | FLAG_6]), number(LEASE_S), number(0), slice(cookie)];
    this.send(Buffer.concat(open));
  }

  subscription() {
    const declare = Buffer.from([DECLARE, DECLARE_SUBSCRIBER | FLAG_5, 1, 0]);
    const key = slice(Buffer.from(this.key));
    return Buffer.concat([Buffer.from([FRAME | FLAG_5]), number(0), declare, key]);
  }

  key_of(reader, named) {
    const known = this.keys.get(reader.number()) ?? "";
    return known + (named ? reader.slice().toString() : "");
  }

  network(reader) {
    const header = reader.byte();
    switch (header & 0x1f) {
      case PUSH: {
        const key = this.key_of(reader, header & FLAG_5);
        reader.extensions(header);
        return this.push(reader, key);
      }
      case DECLARE:
        if (header & FLAG_5) reader.number(); // the interest that it replies to
        reader.extensions(header);
        return this.declared(reader);
      case INTEREST: {
        reader.number();
        const options = header & (FLAG_5 | FLAG_6) ? reader.byte() : 0;
        if (options & 0x10) this.key_of(reader, options & FLAG_5);
        return reader.extensions(header);
      }
      case RESPONSE_FINAL:
        reader.number();
        return reader.extensions(header);
      case OAM:
        reader.number();
        reader.extensions(header);
        return reader.body(header);
      default:
        throw new Error(`network message ${header & 0x1f}`);
    }
  }

  declared(reader) {
    const header = reader.byte();
    const kind = header & 0x1f;
    if (kind !== DECLARE_FINAL) {
      const id = reader.number();
      if (kind === DECLARE_KEY) this.keys.set(id, this.key_of(reader, header & FLAG_5));
      else if (kind === UNDECLARE_KEY) this.keys.delete(id);
      else if (kind % 2 === 0) this.key_of(reader, header & FLAG_5); // declared; odd: undeclared
    }
    reader.extensions(header);
  }

  push(reader, key) {
    const header = reader.byte();
    if ((header & 0x1f) !== PUT) throw new Error(`body ${header & 0x1f} of a message`);
    if (header & FLAG_5) {
      reader.number(); // time
      reader.slice(); // whose
    }
    if (header & FLAG_6 && reader.number() & 1) reader.slice(); // encoding, with a schema
    reader.extensions(header);
    this.received(key, reader.slice());
  }
}
