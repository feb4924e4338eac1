#include "host.h"

#include <string.h>

struct host host;
struct board host_board;

static bool host_self_test(void) { return host.self_test_result; }

static bool host_set_tick_rate(uint32_t tick_Hz)
{
    if (tick_Hz > host.tick_max_Hz) {
        return false;
    }
    host.tick_Hz = tick_Hz;
    host.tick_starts++;
    return true;
}

static void host_set_enable_line(bool closed)
{
    host.line_closed = closed;
    host.line_calls++;
}

static bool host_send(const uint8_t *data, size_t count)
{
    if (count > host.room || host.sent_bytes + count > HOST_SENT_MAX) {
        return false;
    }
    memcpy(host.sent + host.sent_bytes, data, count);
    if (host.sends < HOST_PIECES_MAX) {
        host.send_bytes[host.sends] = (uint16_t)count;
    }
    host.sends++;
    host.sent_bytes += (uint32_t)count;
    host.room -= (uint32_t)count;
    return true;
}

static void host_feed_watchdog(void) { host.feeds++; }

void host_reset(enum board_link link)
{
    memset(&host, 0, sizeof host);
    host.tick_max_Hz = BRIDGE_RATE_MAX_HZ;
    host.self_test_result = true;
    host.room = UINT32_MAX;
    host.line_closed = true; /* bridge_init has to open it */
    host_board = (struct board){
        .name = "host",
        .serial = 7,
        .encoder_lines = 12,
        .speed_max_Hz = 50,
        .adc_full_scale = 4095,
        .rate_max_Hz = BRIDGE_RATE_MAX_HZ,
        .link = link,
        .self_test = host_self_test,
        .set_tick_rate = host_set_tick_rate,
        .set_enable_line = host_set_enable_line,
        .send = host_send,
        .feed_watchdog = host_feed_watchdog,
    };
}

double host_pass(struct bridge *bridge, double ticked_us, double now_us, double end_us,
                 uint32_t lines)
{
    static const uint16_t middle[] = {2048, 2048, 2048, 2048};
    for (;;) {
        const double next_us = ticked_us + 1e6 / host.tick_Hz;
        const double at_us = next_us > now_us ? next_us : now_us;
        if (at_us > end_us) {
            return ticked_us;
        }
        int64_t rounded_us = (int64_t)at_us; /* half to even, as in Python */
        const double part = at_us - (double)rounded_us;
        rounded_us += part > 0.5 || (part == 0.5 && rounded_us % 2 != 0);
        const struct board_reading reading = {
            .t_us = (uint32_t)rounded_us, .lines = lines, .adc = middle, .adc_count = 4};
        bridge_on_tick(bridge, &reading);
        now_us = (double)rounded_us;
        ticked_us = at_us;
    }
}

/* xorshift32 */
static uint32_t state;

static uint32_t draw(uint32_t below)
{
    state ^= state << 13;
    state ^= state >> 17;
    state ^= state << 5;
    return (uint32_t)((uint64_t)state * below >> 32);
}

enum { WIRE_MAX = 64 };

struct wire {
    uint8_t bytes[WIRE_MAX];
    uint32_t count; /* without delimiter */
    uint8_t body[BRIDGE_BODY_MAX];
    size_t body_bytes;
};

static void random_frame(struct wire *wire)
{
    static const uint8_t types[] = {
#define TYPE(code, name) BRIDGE_##name,
        BRIDGE_FRAMES(TYPE)};
    union bridge_frame frame;
    uint8_t raw[sizeof frame];
    for (size_t i = 0; i < sizeof raw; i++) {
        raw[i] = draw(3) == 0 ? 0 : (uint8_t)draw(256);
    }
    memcpy(&frame, raw, sizeof frame);
    frame.type = types[draw(sizeof types)];
    wire->body_bytes = frame_pack(&frame, wire->body);
    wire->count = stream_write(wire->body, (uint8_t)wire->body_bytes, wire->bytes) - 1U;
}

static void flip(uint8_t *bytes, uint32_t bit) { bytes[bit / 8] ^= (uint8_t)(1U << bit % 8); }

/* `other` is the frame that SPLICE takes the tail of. */
static void mutate(struct wire *wire, enum mutation mutation, const struct wire *other)
{
    uint8_t *bytes = wire->bytes;
    const uint32_t bits = wire->count * 8;
    const uint32_t times = 1 + draw(3);
    switch (mutation) {
    case FLIP_BITS:
        for (uint32_t i = 0; i < times; i++) {
            flip(bytes, draw(bits));
        }
        break;
    case BURST: {
        const uint32_t length = 2 + draw(15);
        const uint32_t start = draw(bits - length);
        flip(bytes, start);
        for (uint32_t i = 1; i < length - 1; i++) {
            if (draw(2) != 0) {
                flip(bytes, start + i);
            }
        }
        flip(bytes, start + length - 1);
        break;
    }
    case BYTES:
        for (uint32_t i = 0; i <= times; i++) {
            bytes[draw(wire->count)] = (uint8_t)draw(256);
        }
        break;
    case DROP:
        for (uint32_t i = 0; i < times; i++) {
            const uint32_t at = draw(wire->count);
            memmove(bytes + at, bytes + at + 1, wire->count - at - 1);
            wire->count--;
        }
        break;
    case INSERT:
        for (uint32_t i = 0; i < times; i++) {
            const uint32_t at = draw(wire->count + 1);
            memmove(bytes + at + 1, bytes + at, wire->count - at);
            bytes[at] = (uint8_t)draw(256);
            wire->count++;
        }
        break;
    case SWAP: {
        const uint32_t a = draw(wire->count);
        const uint32_t b = draw(wire->count);
        const uint8_t kept = bytes[a];
        bytes[a] = bytes[b];
        bytes[b] = kept;
        break;
    }
    default: { /* SPLICE */
        const uint32_t head = draw(wire->count + 1);
        const uint32_t tail = draw(other->count + 1);
        const uint32_t kept = tail < WIRE_MAX - head ? tail : WIRE_MAX - head;
        memcpy(bytes + head, other->bytes + other->count - kept, kept);
        wire->count = head + kept;
        break;
    }
    }
}

/* Whether the decoder, fed the bytes and a delimiter, accepts a frame other than `body`. */
static bool accepted(const uint8_t *bytes, uint32_t count, const uint8_t *body, size_t body_bytes)
{
    struct stream_decoder decoder;
    union bridge_frame frame;
    uint8_t again[BRIDGE_BODY_MAX];
    bool any = false;
    stream_reset(&decoder);
    for (uint32_t i = 0; i <= count; i++) {
        const uint8_t byte = i < count ? bytes[i] : 0;
        if (stream_take(&decoder, byte, &frame) == RECEIVED_FRAME) {
            const size_t got = frame_pack(&frame, again);
            any = any || got != body_bytes || memcmp(again, body, got) != 0;
        }
    }
    return any;
}

uint32_t host_mutated(uint32_t seed, uint32_t count, enum mutation mutation)
{
    uint32_t wrong = 0;
    state = seed * 2654435761U | 1U;
    for (uint32_t i = 0; i < count; i++) {
        struct wire wire;
        struct wire other;
        random_frame(&wire);
        random_frame(&other);
        mutate(&wire, mutation, &other);
        wrong += accepted(wire.bytes, wire.count, wire.body, wire.body_bytes) &&
                 accepted(wire.bytes, wire.count, other.body, other.body_bytes);
    }
    return wrong;
}

/* Tries all ways of flipping `bits` of the bits from `from` on; `take` says if it was accepted. */
typedef bool taker(const uint8_t *bytes, uint32_t count, const uint8_t *body, size_t body_bytes);

struct flips {
    uint8_t bytes[WIRE_MAX];
    uint32_t count;
    const uint8_t *body;
    size_t body_bytes;
    taker *take;
    uint32_t tried;
};

static uint32_t flip_all(struct flips *flips, uint32_t from, uint32_t bits)
{
    if (bits == 0) {
        flips->tried++;
        return flips->take(flips->bytes, flips->count, flips->body, flips->body_bytes);
    }
    uint32_t wrong = 0;
    for (uint32_t bit = from; bit < flips->count * 8; bit++) {
        flip(flips->bytes, bit);
        wrong += flip_all(flips, bit + 1, bits - 1);
        flip(flips->bytes, bit);
    }
    return wrong;
}

uint32_t host_flipped(const uint8_t *wire, uint32_t bytes, uint32_t bits, uint32_t *tried)
{
    uint8_t body[WIRE_MAX];
    struct flips flips = {.count = bytes, .body = body, .take = accepted};
    memcpy(flips.bytes, wire, bytes);
    memcpy(body, wire, bytes);
    flips.body_bytes = cobs_decode(body, bytes);
    const uint32_t wrong = flip_all(&flips, 0, bits);
    *tried = flips.tried;
    return wrong;
}

static bool unpacks(const uint8_t *bytes, uint32_t count, const uint8_t *body, size_t body_bytes)
{
    union bridge_frame frame;
    (void)body;
    (void)body_bytes;
    return frame_unpack(bytes, count, &frame);
}

uint32_t host_flipped_body(const uint8_t *body, uint32_t bytes, uint32_t bits, uint32_t *tried)
{
    struct flips flips = {.count = bytes, .take = unpacks};
    memcpy(flips.bytes, body, bytes);
    const uint32_t wrong = flip_all(&flips, 0, bits);
    *tried = flips.tried;
    return wrong;
}

uint32_t host_burst_body(const uint8_t *body, uint32_t bytes, uint32_t within, uint32_t *tried)
{
    uint32_t wrong = 0;
    *tried = 0;
    for (uint32_t start = 0; start + 16 <= within * 8; start++) {
        for (uint32_t pattern = 1; pattern < 0x10000U; pattern += 2) { /* begins at `start` */
            uint8_t hurt[WIRE_MAX];
            union bridge_frame frame;
            memcpy(hurt, body, bytes);
            for (uint32_t bit = 0; bit < 16; bit++) {
                if ((pattern >> bit & 1U) != 0) {
                    const uint32_t at = start + bit; /* in the order of the CRC, highest first */
                    hurt[at / 8] ^= (uint8_t)(0x80U >> at % 8);
                }
            }
            wrong += frame_unpack(hurt, bytes, &frame);
            ++*tried;
        }
    }
    return wrong;
}
