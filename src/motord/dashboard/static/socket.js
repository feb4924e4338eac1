/** The one connection to the server: framing, calls with replies, reconnecting. */

import { SUBPROTOCOL, decode, encode } from "./protocol.js";
import { checkToken } from "./session.js";

const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 3000;
const REPLY_MS = 20000;
const SILENCE_MS = 4000;

/** An RPC that was refused or did not arrive; `code` as in docs/api.md, or `disconnected`. */
export class CallError extends Error {
  /** @param {string} code @param {string} message */
  constructor(code, message) {
    super(message);
    this.code = code;
  }
}

/** @typedef {"connecting" | "open" | "waiting" | "refused"} LinkStatus */

export class Socket {
  /**
   * @param {string} token
   * @param {(header: import("./protocol.js").Header, floats: Float32Array) => void} onMessage
   * @param {(status: LinkStatus, message: string) => void} onStatus
   */
  constructor(token, onMessage, onStatus) {
    this._token = token;
    this._onMessage = onMessage;
    this._onStatus = onStatus;
    this._wait_ms = FIRST_WAIT_MS;
    this._id = 0;
    /** @type {Map<number, {resolve: Function, reject: Function, timer: number}>} */
    this._calls = new Map();
    /** @type {WebSocket | null} */
    this._socket = null;
    this._received_ms = 0;
    this._attempt = 0;
    setInterval(() => this._checkSilence(), 1000);
    addEventListener("online", () => this._soon());
  }

  get open() {
    return this._socket?.readyState === WebSocket.OPEN;
  }

  async connect() {
    const attempt = ++this._attempt;
    this._onStatus("connecting", "");
    const session = await checkToken(this._token);
    if (attempt !== this._attempt) return; // another attempt began meanwhile
    if (session.status === "bad") return this._onStatus("refused", session.message);
    if (session.status === "unreachable") return this._again(session.message);
    const url = new URL("socket", location.href);
    url.protocol = url.protocol.replace("http", "ws");
    url.hash = "";
    const socket = (this._socket = new WebSocket(url, [SUBPROTOCOL, this._token]));
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this._wait_ms = FIRST_WAIT_MS;
      this._received_ms = performance.now();
      this._onStatus("open", "");
    };
    socket.onmessage = (event) => {
      if (socket === this._socket) this._received(event.data);
    };
    socket.onclose = (event) => this._closed(socket, event.reason);
  }

  /** @param {import("./protocol.js").Header} header @returns {boolean} whether it was sent */
  send(header) {
    if (!this.open) return false;
    this._socket?.send(encode(header));
    return true;
  }

  /**
   * Ask the daemon. What cannot be sent now is never sent later: nothing moves by itself.
   * @param {string} name
   * @param {Record<string, any>} [args]
   * @returns {Promise<any>} the reply; rejects with CallError
   */
  call(name, args = {}) {
    return new Promise((resolve, reject) => {
      const id = ++this._id;
      if (!this.send({ kind: "rpc", id, name, arguments: args })) {
        reject(new CallError("disconnected", `not sent: no connection (${name})`));
        return;
      }
      const timer = setTimeout(() => {
        this._calls.delete(id);
        reject(new CallError("timeout", `no answer to ${name}: look at the state before trying again`));
      }, REPLY_MS);
      this._calls.set(id, { resolve, reject, timer });
    });
  }

  /** @param {ArrayBuffer} data */
  _received(data) {
    this._received_ms = performance.now();
    const { header, floats } = decode(data);
    if (header.kind === "ping") this.send({ kind: "pong", n: header.n });
    else if (header.kind === "reply") this._replied(header);
    else this._onMessage(header, floats);
  }

  /** @param {import("./protocol.js").Header} header */
  _replied(header) {
    const call = this._calls.get(header.id);
    if (call === undefined) return;
    this._calls.delete(header.id);
    clearTimeout(call.timer);
    if (header.error) call.reject(new CallError(header.error.code, header.error.message));
    else call.resolve(header.reply);
  }

  /** @param {WebSocket} socket @param {string} reason */
  _closed(socket, reason) {
    if (socket !== this._socket) return;
    this._socket = null;
    for (const call of this._calls.values()) {
      clearTimeout(call.timer);
      call.reject(new CallError("disconnected", "the connection ended before the answer came"));
    }
    this._calls.clear();
    this._again(reason || "the connection ended");
  }

  /** @param {string} message */
  _again(message) {
    this._onStatus("waiting", message);
    clearTimeout(this._timer);
    this._timer = setTimeout(() => this.connect(), this._wait_ms);
    this._wait_ms = Math.min(this._wait_ms * 2, LONGEST_WAIT_MS);
  }

  _soon() {
    if (this._socket !== null) return;
    clearTimeout(this._timer);
    this.connect();
  }

  /** A network that is gone closes nothing: the server sends something every second. */
  _checkSilence() {
    if (this.open && performance.now() - this._received_ms > SILENCE_MS) this._socket?.close();
  }
}
