/**
 * Frames of the socket (subprotocol `motord.1`), both directions: u32 length of a header, little-endian; the header,
 * JSON padded with spaces to a multiple of four bytes; 32-bit floats, little-endian, none in most messages.
 */

export const SUBPROTOCOL = "motord.1";

/** @typedef {{kind: string, [field: string]: any}} Header */

const decoder = new TextDecoder();
const encoder = new TextEncoder();

/**
 * @param {ArrayBuffer} frame
 * @returns {{header: Header, floats: Float32Array}} the floats are a view of the frame
 * @throws {Error} if it is not a frame
 */
export function decode(frame) {
  if (frame.byteLength < 4) throw new Error("frame: shorter than its length");
  const length = new DataView(frame).getUint32(0, true);
  const start = 4 + length;
  if (length % 4 !== 0 || start > frame.byteLength || (frame.byteLength - start) % 4 !== 0) {
    throw new Error(`frame: a header of ${length} bytes in ${frame.byteLength}`);
  }
  const header = JSON.parse(decoder.decode(new Uint8Array(frame, 4, length)));
  if (typeof header?.kind !== "string") throw new Error("frame: a header without kind");
  return { header, floats: new Float32Array(frame, start) };
}

/**
 * @param {Header} header
 * @returns {Uint8Array}
 */
export function encode(header) {
  const text = encoder.encode(JSON.stringify(header));
  const length = Math.ceil(text.length / 4) * 4;
  const frame = new Uint8Array(4 + length).fill(0x20);
  new DataView(frame.buffer).setUint32(0, length, true);
  frame.set(text, 4);
  return frame;
}
