/* Frames to bytes and back, and the hash of their layouts. Pure; any context. */
#ifndef PROTOCOL_CODEC_H
#define PROTOCOL_CODEC_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "protocol/bridge_frames.h"

/* Writes the body of `frame` (type, sequence, payload, CRC-16; little-endian) to `body`, which has
 * room for BRIDGE_BODY_MAX. Returns its bytes, 0 if frame->type is none of the protocol's. */
size_t frame_pack(const union bridge_frame *frame, uint8_t *body);

/* Reads a body. False, and `frame` is left as it was, if length, type or CRC are not right. */
bool frame_unpack(const uint8_t *body, size_t count, union bridge_frame *frame);

/* Bytes of the body of a frame of type `type`, 0 if there is none such. */
size_t frame_body_bytes(uint8_t type);

/* CRC-32 over the names and layouts of all frames: what Hello.layout says. Goes bit by bit,
 * so it is computed once, at boot. */
uint32_t frame_layout_hash(void);

#endif
