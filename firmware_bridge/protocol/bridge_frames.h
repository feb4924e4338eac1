/* The frames between host and bridge board: the one definition, for both sides.
 *
 * From these lists the preprocessor makes the C structures, their encoding and the text whose
 * CRC-32 a board names in Hello (frame_layout_hash). `tools/bridge_layout` makes
 * src/motord/wire/bridge/layout.py of them. docs/protocols.md says what the fields mean and who
 * sends what when.
 *
 * FRAME(code, Name): the type byte and the name. Codes are decimal because they are part of the
 * hashed text; the board's frames are below 16, the host's above.
 * FIELD(letter, name): the width, as Python's struct module writes it (little-endian, packed):
 * B u8, H u16, I u32, i i32, 16s sixteen bytes.
 */
#ifndef PROTOCOL_BRIDGE_FRAMES_H
#define PROTOCOL_BRIDGE_FRAMES_H

#include <stdint.h>

#define BRIDGE_PROTOCOL 2

/* clang-format off */
#define BRIDGE_FRAMES(FRAME) \
    FRAME(1, Hello) \
    FRAME(2, Sample) \
    FRAME(3, Status) \
    FRAME(17, HelloRequest) \
    FRAME(18, Configure) \
    FRAME(19, Start) \
    FRAME(20, Stop) \
    FRAME(21, Heartbeat)

#define BRIDGE_FIELDS_Hello(FIELD) \
    FIELD(H, protocol) \
    FIELD(I, firmware) \
    FIELD(16s, board) \
    FIELD(I, serial) \
    FIELD(I, rate_Hz) \
    FIELD(I, counts) \
    FIELD(I, layout) \
    FIELD(I, heartbeat_next)

#define BRIDGE_FIELDS_Sample(FIELD) \
    FIELD(I, t_us) \
    FIELD(I, encoder_gray) \
    FIELD(i, torque_counts) \
    FIELD(H, status)

#define BRIDGE_FIELDS_Status(FIELD) \
    FIELD(I, t_us) \
    FIELD(H, status) \
    FIELD(H, heartbeat_sequence) \
    FIELD(I, heartbeat_t_us) \
    FIELD(I, heartbeats) \
    FIELD(I, errors) \
    FIELD(I, dropped) \
    FIELD(I, rate_Hz) \
    FIELD(I, heartbeat_timeout_us) \
    FIELD(B, streaming)

#define BRIDGE_FIELDS_HelloRequest(FIELD) \
    FIELD(H, protocol)

#define BRIDGE_FIELDS_Configure(FIELD) \
    FIELD(I, rate_Hz) \
    FIELD(I, heartbeat_timeout_us)

#define BRIDGE_FIELDS_Start(FIELD)

#define BRIDGE_FIELDS_Stop(FIELD)

#define BRIDGE_FIELDS_Heartbeat(FIELD) \
    FIELD(B, turns_enable)
/* clang-format on */

/* Heartbeats count further than `sequence` does: their number is turns << 16 | sequence. */
enum { BRIDGE_HEARTBEAT_ENABLE = 1, BRIDGE_HEARTBEAT_NUMBERS = 1 << 23 };

/* Bits of `status` in Sample and Status. */
enum bridge_status {
    BRIDGE_STATUS_ENABLE_LINE = 1 << 0,     /* the enable line is closed */
    BRIDGE_STATUS_HEARTBEAT_LOST = 1 << 1,  /* no heartbeat in time, the line was opened */
    BRIDGE_STATUS_TORQUE_INVALID = 1 << 2,  /* saturated, or no ADC reading */
    BRIDGE_STATUS_ENCODER_INVALID = 1 << 3, /* the lines jump as no shaft does */
    BRIDGE_STATUS_FAULT = 1 << 4,           /* the self-test failed */
    BRIDGE_STATUS_BARRED = 1 << 5,          /* a host of another protocol asked: the line stays open */
    BRIDGE_STATUS_OTHER_BOARD = 1 << 6      /* the host's own, in its records: a board leaves it 0 */
};

/* Made of the lists: type codes BRIDGE_Hello ..., structures struct bridge_Hello ..., the union of
 * all, and the bytes of each frame's body (type, sequence, payload, CRC-16) BRIDGE_BODY_Hello ... */
#define BRIDGE_TYPE_B(name) uint8_t name;
#define BRIDGE_TYPE_H(name) uint16_t name;
#define BRIDGE_TYPE_I(name) uint32_t name;
#define BRIDGE_TYPE_i(name) int32_t name;
#define BRIDGE_TYPE_16s(name) uint8_t name[16];
#define BRIDGE_BYTES_B 1
#define BRIDGE_BYTES_H 2
#define BRIDGE_BYTES_I 4
#define BRIDGE_BYTES_i 4
#define BRIDGE_BYTES_16s 16

#define BRIDGE_MEMBER(letter, name) BRIDGE_TYPE_##letter(name)
#define BRIDGE_STRUCT(code, name)       \
    struct bridge_##name {              \
        uint8_t type;                   \
        uint16_t sequence;              \
        BRIDGE_FIELDS_##name(BRIDGE_MEMBER) \
    };
BRIDGE_FRAMES(BRIDGE_STRUCT)

/* A frame: which one `type` says. All members begin with type and sequence. */
union bridge_frame {
    struct {
        uint8_t type;
        uint16_t sequence;
    };
#define BRIDGE_UNION_MEMBER(code, name) struct bridge_##name name;
    BRIDGE_FRAMES(BRIDGE_UNION_MEMBER)
};

enum bridge_type {
#define BRIDGE_CODE(code, name) BRIDGE_##name = (code),
    BRIDGE_FRAMES(BRIDGE_CODE)
    BRIDGE_FROM_HOST = 16 /* codes from here on are the host's */
};

enum bridge_body_bytes {
#define BRIDGE_PLUS(letter, name) +BRIDGE_BYTES_##letter
#define BRIDGE_BODY(code, name) BRIDGE_BODY_##name = 5 BRIDGE_FIELDS_##name(BRIDGE_PLUS),
    BRIDGE_FRAMES(BRIDGE_BODY)
    BRIDGE_BODY_MIN = 5, /* type 1, sequence 2, CRC 2 */
    BRIDGE_BODY_MAX = 47
};

#define BRIDGE_FITS(code, name) \
    _Static_assert(BRIDGE_BODY_##name <= BRIDGE_BODY_MAX, "BRIDGE_BODY_MAX is too small");
BRIDGE_FRAMES(BRIDGE_FITS)

#endif
