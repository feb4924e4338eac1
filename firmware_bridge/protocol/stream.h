/* Frames out of a stream of bytes: whatever comes in, it is in step again after the next zero. */
#ifndef PROTOCOL_STREAM_H
#define PROTOCOL_STREAM_H

#include <stdbool.h>
#include <stdint.h>

#include "protocol/bridge_frames.h"

enum { STREAM_STUFFED_MAX = BRIDGE_BODY_MAX + 1 }; /* of a frame on the wire, without delimiter */

enum received {
    RECEIVED_NOTHING, /* in the middle of a frame, or between two */
    RECEIVED_FRAME,   /* a good frame is complete */
    RECEIVED_CORRUPT  /* something ended that is no frame */
};

struct stream_decoder {
    uint8_t stuffed[STREAM_STUFFED_MAX];
    uint8_t count; /* of the bytes since the delimiter; STREAM_STUFFED_MAX + 1: too many */
};

/* Starts between two frames. */
void stream_reset(struct stream_decoder *decoder);

/* Takes one byte. `frame` is written only with RECEIVED_FRAME. One context only (the receive
 * interrupt). */
enum received stream_take(struct stream_decoder *decoder, uint8_t byte, union bridge_frame *frame);

/* Writes `count` <= BRIDGE_BODY_MAX bytes of a body as they go onto the wire, delimiter included,
 * to `wire`, which has room for STREAM_STUFFED_MAX + 1. Returns the bytes written. */
uint8_t stream_write(const uint8_t *body, uint8_t count, uint8_t *wire);

#endif
