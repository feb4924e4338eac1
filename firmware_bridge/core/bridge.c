#include "core/bridge.h"

#include <string.h>

#include "core/clock.h"
#include "core/self_test.h"
#include "core/torque.h"
#include "protocol/codec.h"

static void drive_line(const struct bridge *bridge)
{
    bridge->board->set_enable_line(enable_line_closed(&bridge->line));
}

/* ---- what the board sends; in the interrupts, or before they are let loose */

static void put_hello(struct bridge *bridge)
{
    const struct board *board = bridge->board;
    union bridge_frame frame = {.Hello = {
                                    .type = BRIDGE_Hello,
                                    .protocol = BRIDGE_PROTOCOL,
                                    .firmware = BRIDGE_FIRMWARE,
                                    .serial = board->serial,
                                    .rate_Hz = bridge->rate_Hz,
                                    .counts = 1U << board->encoder_lines,
                                    .layout = bridge->layout_hash,
                                    .heartbeat_next = bridge->heartbeat_next,
                                }};
    for (size_t i = 0; i < sizeof frame.Hello.board && board->name[i] != '\0'; i++) {
        frame.Hello.board[i] = (uint8_t)board->name[i];
    }
    (void)ring_put(&bridge->outgoing, &frame, 0); /* without room: the host asks again */
}

static uint16_t status_bits(const struct bridge *bridge)
{
    unsigned bits = bridge->sample_status;
    bits |= enable_line_closed(&bridge->line) ? BRIDGE_STATUS_ENABLE_LINE : 0U;
    bits |= bridge->line.state == LINE_LOST ? BRIDGE_STATUS_HEARTBEAT_LOST : 0U;
    if (!bridge->self_test_passed) {
        bits |= BRIDGE_STATUS_FAULT;
    } else if (bridge->line.state == LINE_BARRED) {
        bits |= BRIDGE_STATUS_BARRED;
    }
    return (uint16_t)bits;
}

static void put_status(struct bridge *bridge)
{
    const union bridge_frame frame = {
        .Status = {
            .type = BRIDGE_Status,
            .t_us = bridge->t_us,
            .status = status_bits(bridge),
            .heartbeat_sequence = bridge->heartbeat_sequence,
            .heartbeat_t_us = bridge->heartbeat_t_us,
            .heartbeats = bridge->heartbeats,
            .errors = sequence_errors(&bridge->receiver.check),
            .dropped = bridge->dropped,
            .rate_Hz = bridge->rate_Hz,
            .heartbeat_timeout_us = bridge->line.timeout_us,
            .streaming = bridge->streaming,
        }};
    bridge->status_t_us = bridge->t_us;
    (void)ring_put(&bridge->outgoing, &frame, 0);
}

/* ---- sampling; in the tick interrupt */

/* Takes up a sample rate, if it is in range and the timer can do it. */
static bool set_rate(struct bridge *bridge, uint32_t rate_Hz)
{
    const struct board *board = bridge->board;
    if (rate_Hz < BRIDGE_RATE_MIN_HZ || rate_Hz > board->rate_max_Hz) {
        return false;
    }
    const uint32_t ticks_per_sample = (BRIDGE_TICK_MIN_HZ + rate_Hz - 1U) / rate_Hz;
    const uint32_t tick_Hz = rate_Hz * ticks_per_sample;
    if (!board->set_tick_rate(tick_Hz)) {
        return false;
    }
    gray_filter_speed(&bridge->encoder, board->speed_max_Hz, tick_Hz);
    bridge->tick_least_us = 1000000U / tick_Hz / 2U;
    bridge->rate_Hz = rate_Hz;
    bridge->ticks_per_sample = ticks_per_sample;
    bridge->ticks_to_sample = ticks_per_sample;
    return true;
}

static void put_sample(struct bridge *bridge, uint32_t lines)
{
    const union bridge_frame frame = {.Sample = {
                                          .type = BRIDGE_Sample,
                                          .t_us = bridge->t_us,
                                          .encoder_gray = lines,
                                          .torque_counts = bridge->torque_counts,
                                          .status = status_bits(bridge),
                                      }};
    if (!ring_put(&bridge->outgoing, &frame, RING_RESERVED)) {
        bridge->dropped++;
    }
}

static void sample(struct bridge *bridge, const struct board_reading *reading, uint32_t lines)
{
    const struct torque_sample torque =
        torque_average(reading->adc, reading->adc_count, bridge->board->adc_full_scale);
    bridge->torque_counts = torque.counts;
    bridge->sample_status = (uint16_t)((torque.valid ? 0 : BRIDGE_STATUS_TORQUE_INVALID) |
                                       (bridge->encoder_valid ? 0 : BRIDGE_STATUS_ENCODER_INVALID));
    bridge->encoder_valid = true;
    if (bridge->streaming) {
        put_sample(bridge, lines);
    }
}

/* A clock that stands or crawls never ends a heartbeat timeout, and its ticks feed no watchdog. */
static void count_tick(struct bridge *bridge, uint32_t t_us)
{
    if (clock_since(t_us, bridge->tick_t_us) >= bridge->tick_least_us) {
        atomic_fetch_add_explicit(&bridge->ticks, 1U, memory_order_relaxed);
    }
    bridge->tick_t_us = t_us;
}

void bridge_on_tick(struct bridge *bridge, const struct board_reading *reading)
{
    bridge->t_us = reading->t_us;
    enable_line_judge(&bridge->line, reading->t_us);
    drive_line(bridge);
    const struct gray_reading encoder = gray_filter_take(&bridge->encoder, reading->lines);
    bridge->encoder_valid = bridge->encoder_valid && encoder.valid;
    if (--bridge->ticks_to_sample == 0) {
        bridge->ticks_to_sample = bridge->ticks_per_sample;
        sample(bridge, reading, encoder.lines);
    }
    if (bridge->streaming &&
        clock_since(reading->t_us, bridge->status_t_us) >= BRIDGE_STATUS_PERIOD_US) {
        put_status(bridge);
    }
    count_tick(bridge, reading->t_us);
}

/* ---- what the host says; in the receive interrupt */

static void receive_hello_request(struct bridge *bridge, uint16_t protocol)
{
    if (protocol != BRIDGE_PROTOCOL) {
        enable_line_bar(&bridge->line);
    } else if (bridge->self_test_passed) {
        enable_line_permit(&bridge->line);
    }
    put_hello(bridge);
}

/* All of it or nothing. It is a host that starts:
 * the line opens, so that an old Configure cannot prolong the time of a host that fell silent. */
static void receive_configure(struct bridge *bridge, uint32_t rate_Hz, uint32_t timeout_us)
{
    if (timeout_us >= BRIDGE_TIMEOUT_MIN_US && timeout_us <= BRIDGE_TIMEOUT_MAX_US &&
        set_rate(bridge, rate_Hz)) {
        enable_line_stop(&bridge->line, bridge->t_us);
        bridge->line.timeout_us = timeout_us;
    }
    put_status(bridge);
}

static bool asks_to_close(const struct bridge_Heartbeat *heartbeat)
{
    return (heartbeat->turns_enable & BRIDGE_HEARTBEAT_ENABLE) != 0;
}

static void receive_heartbeat(struct bridge *bridge, const struct bridge_Heartbeat *heartbeat)
{
    bridge->heartbeats++;
    bridge->heartbeat_sequence = heartbeat->sequence;
    bridge->heartbeat_t_us = bridge->t_us;
    enable_line_heartbeat(&bridge->line, bridge->t_us, asks_to_close(heartbeat));
}

static void receive(struct bridge *bridge, const union bridge_frame *frame)
{
    switch (frame->type) {
    case BRIDGE_Heartbeat:
        receive_heartbeat(bridge, &frame->Heartbeat);
        break;
    case BRIDGE_HelloRequest:
        receive_hello_request(bridge, frame->HelloRequest.protocol);
        break;
    case BRIDGE_Configure:
        receive_configure(bridge, frame->Configure.rate_Hz, frame->Configure.heartbeat_timeout_us);
        break;
    case BRIDGE_Start:
        bridge->streaming = true;
        put_status(bridge);
        break;
    default: /* BRIDGE_Stop: there is no other of a host's */
        bridge->streaming = false;
        enable_line_stop(&bridge->line, bridge->t_us);
        put_status(bridge);
        break;
    }
}

/* Whether a heartbeat is newer than every one before it. Nothing lets its number step back but a
 * reset: no silence, no HelloRequest (a host that starts goes on from the number in Hello). A
 * buffer on the way that sends old heartbeats, or old sessions, over and over is no living host. */
static bool is_newer(struct bridge *bridge, const struct bridge_Heartbeat *heartbeat)
{
    const uint32_t number = (uint32_t)(heartbeat->turns_enable >> 1) << 16 | heartbeat->sequence;
    const uint32_t ahead = (number - bridge->heartbeat_next) % BRIDGE_HEARTBEAT_NUMBERS;
    if (bridge->heartbeat_known && ahead >= BRIDGE_HEARTBEAT_NUMBERS / 2) {
        return false;
    }
    bridge->heartbeat_known = true;
    bridge->heartbeat_next = (number + 1U) % BRIDGE_HEARTBEAT_NUMBERS;
    return true;
}

/* Checks a good frame's number. HelloRequest is a host that starts: the next frame begins a count.
 * No other frame may step back; a heartbeat's number is judged by all of its bits. */
static bool accept(struct bridge *bridge, const union bridge_frame *frame)
{
    struct sequence_check *check = &bridge->receiver.check;
    if (frame->type == BRIDGE_HelloRequest) {
        sequence_restart(check);
        return true;
    }
    const bool beats = frame->type == BRIDGE_Heartbeat;
    if (beats && !is_newer(bridge, &frame->Heartbeat)) {
        sequence_corrupt(check);
        return false;
    }
    return sequence_accept(check, frame->sequence, beats);
}

/* A good frame came. What asks for an open line is obeyed whatever its number; but a repeated
 * heartbeat with enable = 0 takes nothing from the one that it repeats. */
static void take(struct bridge *bridge, const union bridge_frame *frame)
{
    if (frame->type < BRIDGE_FROM_HOST) {
        sequence_corrupt(&bridge->receiver.check); /* a board's frame: an echo of somebody's */
    } else if (accept(bridge, frame)) {
        receive(bridge, frame);
    } else if (frame->type == BRIDGE_Stop ||
               (frame->type == BRIDGE_Heartbeat && !asks_to_close(&frame->Heartbeat) &&
                enable_line_closed(&bridge->line))) {
        enable_line_stop(&bridge->line, bridge->t_us);
    }
}

void bridge_on_received(struct bridge *bridge, uint32_t t_us, const uint8_t *data, size_t count)
{
    bridge->t_us = t_us;
    size_t at = 0;
    while (at < count) {
        union bridge_frame frame;
        enum received what;
        at += link_receive(&bridge->receiver, data + at, count - at, &what, &frame);
        if (what == RECEIVED_FRAME) {
            take(bridge, &frame);
        }
    }
    drive_line(bridge);
}

/* ---- the main loop */

void bridge_init(struct bridge *bridge, const struct board *board)
{
    memset(bridge, 0, sizeof *bridge);
    bridge->board = board;
    enable_line_init(&bridge->line, BRIDGE_TIMEOUT_DEFAULT_US);
    drive_line(bridge);
    bridge->layout_hash = frame_layout_hash();
    link_receiver_init(&bridge->receiver, board->link);
    link_sender_init(&bridge->sender, board->link);
    gray_filter_init(&bridge->encoder, board->encoder_lines);
    const bool core_works = self_test();
    const bool board_works = board->self_test();
    const bool timer_works = set_rate(bridge, BRIDGE_RATE_DEFAULT_HZ);
    bridge->self_test_passed = core_works & board_works & timer_works;
    bridge->sample_status = BRIDGE_STATUS_ENCODER_INVALID | BRIDGE_STATUS_TORQUE_INVALID;
    if (!bridge->self_test_passed) {
        enable_line_bar(&bridge->line);
    }
    put_hello(bridge);
}

void bridge_poll(struct bridge *bridge)
{
    const uint32_t ticks = atomic_load_explicit(&bridge->ticks, memory_order_relaxed);
    if (ticks != bridge->ticks_seen) {
        bridge->ticks_seen = ticks;
        bridge->board->feed_watchdog();
    }
    union bridge_frame frame;
    while (link_send(&bridge->sender, bridge->board->send) && ring_take(&bridge->outgoing, &frame)) {
        link_load(&bridge->sender, &frame);
    }
}
