// motord.Tick and motord.Ticks, of tick.proto read at run time.
import protobuf from "protobufjs";

export class TickReader {
  constructor(proto) {
    const root = new protobuf.Root().loadSync(proto, { keepCase: true });
    this.tick = root.lookupType("motord.Tick");
    this.ticks = root.lookupType("motord.Ticks");
  }

  // Return a line for each tick of a payload, name=value for every field.
  lines(payload, block) {
    const messages = block ? this.ticks.decode(payload).ticks : [this.tick.decode(payload)];
    return messages.map((message) =>
      this.tick.fieldsArray.map((field) => `${field.name}=${message[field.name]}`).join(" "),
    );
  }
}
