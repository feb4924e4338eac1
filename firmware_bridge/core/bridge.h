/* The bridge board, apart from its hardware: samples, commands, heartbeat, enable line.
 *
 * A board has one static `struct bridge` and calls:
 *   at boot, interrupts off:  bridge_init
 *   tick timer interrupt:     bridge_on_tick
 *   receive interrupt:        bridge_on_received
 *   main loop, for ever:      bridge_poll
 *
 * Who shares what. The two interrupts have one priority and never interrupt each other; everything
 * that decides lives in them: decoding, the enable line, sampling. They hand frames to the main
 * loop through one ring (the interrupts its one producer, the main loop its one consumer), and a
 * count of ticks. The main loop hands nothing back but the ring's tail. So nothing the main loop
 * does, or fails to do, reaches the enable line.
 *
 * All times are the board's clock in microseconds, which wraps at 2^32.
 */
#ifndef CORE_BRIDGE_H
#define CORE_BRIDGE_H

#include <stddef.h>
#include <stdint.h>

#include "boards/board.h"
#include "core/enable_line.h"
#include "core/gray.h"
#include "core/link.h"
#include "core/ring.h"
#include "protocol/bridge_frames.h"

#define BRIDGE_FIRMWARE (1U << 16 | 3U << 8 | 0U) /* major, minor, patch */

enum {
    BRIDGE_RATE_MIN_HZ = 100,
    BRIDGE_RATE_MAX_HZ = 20000,
    BRIDGE_RATE_DEFAULT_HZ = 1000,
    BRIDGE_TICK_MIN_HZ = 2000, /* the enable line is judged at least so often, streaming or not */
    BRIDGE_TIMEOUT_MIN_US = 1000,
    BRIDGE_TIMEOUT_MAX_US = 1000000,
    BRIDGE_TIMEOUT_DEFAULT_US = 50000,
    BRIDGE_STATUS_PERIOD_US = 50000 /* Status while streaming */
};

struct bridge {
    const struct board *board;
    uint32_t layout_hash;
    bool self_test_passed;

    /* the interrupts' */
    struct enable_line line;
    struct gray_filter encoder;
    struct link_receiver receiver;
    uint32_t t_us;      /* of the newest tick or reception */
    uint32_t tick_t_us; /* of the newest tick */
    uint32_t tick_least_us; /* half a period: from tick to tick, by a clock that runs */
    uint32_t rate_Hz;
    uint32_t ticks_per_sample;
    uint32_t ticks_to_sample;
    uint32_t status_t_us; /* when Status was last sent */
    int32_t torque_counts;
    uint32_t heartbeats;
    uint32_t heartbeat_next; /* number after the newest heartbeat's */
    uint32_t heartbeat_t_us;
    uint32_t dropped;
    uint16_t heartbeat_sequence;
    uint16_t sample_status; /* torque and encoder bits of the newest sample */
    bool encoder_valid;     /* at every tick since that sample */
    bool heartbeat_known;   /* `heartbeat_next` holds: there was one since reset */
    bool streaming;

    /* from the interrupts to the main loop */
    struct ring outgoing;
    _Atomic uint32_t ticks; /* by a clock that runs */

    /* the main loop's */
    struct link_sender sender;
    uint32_t ticks_seen;
};

/* Sets everything to its start: runs the self-test, leaves the enable line open, sets the tick
 * rate, makes ready a Hello. Before the interrupts are let loose. `board` stays in use. */
void bridge_init(struct bridge *bridge, const struct board *board);

/* The tick interrupt: judges the enable line, filters the encoder, and samples when it is time.
 * `reading` is used during the call only. */
void bridge_on_tick(struct bridge *bridge, const struct board_reading *reading);

/* The receive interrupt: bytes as they come, cut anywhere (serial), or the data field of exactly
 * one CAN frame with the host's identifier. `t_us` is the clock at the interrupt's begin. All of it
 * is decoded in the one call, and no tick comes meanwhile: hand over at most some 256 bytes. */
void bridge_on_received(struct bridge *bridge, uint32_t t_us, const uint8_t *data, size_t count);

/* The main loop: sends what waits, as far as the link has room; feeds the watchdog if the tick
 * interrupt has run since the last call, by a clock that runs. Returns soon; call it again and again (it may sleep until
 * the next interrupt in between). */
void bridge_poll(struct bridge *bridge);

#endif
