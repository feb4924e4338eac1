/* Frames from the interrupts to the main loop: one producer, one consumer, no locks.
 *
 * Only the producer writes `head` and the slots that are free; only the consumer writes `tail`. An
 * index is published (release) after the slot it covers is written or read, and read (acquire)
 * before; both only ever count up, and their difference is what the ring holds. On one core this
 * costs a barrier; it holds on several as well. */
#ifndef CORE_RING_H
#define CORE_RING_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "protocol/bridge_frames.h"

enum {
    RING_FRAMES = 64,  /* a power of two: 12.8 ms of samples at 5 kHz */
    RING_RESERVED = 8  /* slots that samples leave to answers */
};

struct ring {
    union bridge_frame slots[RING_FRAMES];
    _Atomic uint32_t head; /* frames put in so far */
    _Atomic uint32_t tail; /* frames taken out so far */
};

/* Puts a copy of `frame` in. Producer only. False if fewer than `keep_free` + 1 slots are free. */
bool ring_put(struct ring *ring, const union bridge_frame *frame, uint32_t keep_free);

/* Takes the oldest out. Consumer only. False if there is none. */
bool ring_take(struct ring *ring, union bridge_frame *frame);

#endif
