#include "protocol/codec.h"

#include <string.h>

#include "protocol/crc.h"

/* Writing and reading a field of each width, whatever this machine's byte order. */
static uint8_t *put_B(uint8_t *at, const uint8_t *value)
{
    *at = *value;
    return at + 1;
}

static uint8_t *put_H(uint8_t *at, const uint16_t *value)
{
    at[0] = (uint8_t)(*value & 0xFFU);
    at[1] = (uint8_t)(*value >> 8);
    return at + 2;
}

static uint8_t *put_I(uint8_t *at, const uint32_t *value)
{
    for (unsigned i = 0; i < 4; i++) {
        at[i] = (uint8_t)(*value >> (8 * i));
    }
    return at + 4;
}

static uint8_t *put_i(uint8_t *at, const int32_t *value)
{
    const uint32_t bits = (uint32_t)*value;
    return put_I(at, &bits);
}

static uint8_t *put_16s(uint8_t *at, const uint8_t (*value)[16])
{
    memcpy(at, *value, 16);
    return at + 16;
}

static const uint8_t *get_B(const uint8_t *at, uint8_t *value)
{
    *value = *at;
    return at + 1;
}

static const uint8_t *get_H(const uint8_t *at, uint16_t *value)
{
    *value = (uint16_t)(at[0] | at[1] << 8);
    return at + 2;
}

static const uint8_t *get_I(const uint8_t *at, uint32_t *value)
{
    *value = at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
    return at + 4;
}

static const uint8_t *get_i(const uint8_t *at, int32_t *value)
{
    uint32_t bits;
    at = get_I(at, &bits);
    memcpy(value, &bits, sizeof bits); /* two's complement, which C11 lets int32_t be only */
    return at;
}

static const uint8_t *get_16s(const uint8_t *at, uint8_t (*value)[16])
{
    memcpy(*value, at, 16);
    return at + 16;
}

#define PUT_FIELD(letter, name) at = put_##letter(at, &payload->name);
#define GET_FIELD(letter, name) at = get_##letter(at, &payload->name);

#define CASE_PUT(code, name)                                \
    case BRIDGE_##name: {                                   \
        const struct bridge_##name *payload = &frame->name; \
        (void)payload;                                      \
        BRIDGE_FIELDS_##name(PUT_FIELD) break;              \
    }

#define CASE_GET(code, name)                          \
    case BRIDGE_##name: {                             \
        struct bridge_##name *payload = &frame->name; \
        (void)payload;                                \
        if (count != BRIDGE_BODY_##name) {            \
            return false;                             \
        }                                             \
        BRIDGE_FIELDS_##name(GET_FIELD) break;        \
    }

#define CASE_BYTES(code, name) \
    case BRIDGE_##name:        \
        return BRIDGE_BODY_##name;

size_t frame_body_bytes(uint8_t type)
{
    switch (type) {
        BRIDGE_FRAMES(CASE_BYTES)
    default:
        return 0;
    }
}

size_t frame_pack(const union bridge_frame *frame, uint8_t *body)
{
    uint8_t *at = put_H(put_B(body, &frame->type), &frame->sequence);
    switch (frame->type) {
        BRIDGE_FRAMES(CASE_PUT)
    default:
        return 0;
    }
    const uint16_t crc = crc16(body, (size_t)(at - body));
    return (size_t)(put_H(at, &crc) - body);
}

bool frame_unpack(const uint8_t *body, size_t count, union bridge_frame *frame)
{
    if (count < BRIDGE_BODY_MIN) {
        return false;
    }
    uint16_t crc;
    get_H(body + count - 2, &crc);
    if (crc != crc16(body, count - 2)) {
        return false;
    }
    const uint8_t *at = body + 3;
    switch (body[0]) {
        BRIDGE_FRAMES(CASE_GET)
    default:
        return false;
    }
    (void)at;
    frame->type = body[0];
    get_H(body + 1, &frame->sequence);
    return true;
}

/* The text that both sides hash, in the parts that the preprocessor can make of the lists:
 * ";1:Hello:" "HI16s..." ":" "protocol,firmware,..." for each frame, without the first ";". */
struct part {
    const char *text;
    size_t bytes;
};

#define LETTER_TEXT(letter, name) #letter
#define FIELD_TEXT(letter, name) "," #name
#define PART(text) {text, sizeof(text) - 1},
/* without its first character, if it has any */
#define PART_BUT_FIRST(text) {&(text)[sizeof(text) > 1], sizeof(text) - 1 - (sizeof(text) > 1)},
#define LAYOUT_PARTS(code, name)             \
    PART(";" #code ":" #name ":")            \
    PART("" BRIDGE_FIELDS_##name(LETTER_TEXT)) \
    PART(":")                                \
    PART_BUT_FIRST("" BRIDGE_FIELDS_##name(FIELD_TEXT))

uint32_t frame_layout_hash(void)
{
    static const struct part parts[] = {BRIDGE_FRAMES(LAYOUT_PARTS)};
    uint32_t hash = 0;
    size_t skip = 1;
    for (size_t i = 0; i < sizeof parts / sizeof parts[0]; i++) {
        hash = crc32(hash, parts[i].text + skip, parts[i].bytes - skip);
        skip = 0;
    }
    return hash;
}
