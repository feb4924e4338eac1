#include "feed.h"

#define BEGINS 0x80U
#define BITS 7U
#define LOW_BITS 0x7FU

static uint8_t check(const uint8_t *bytes, uint32_t count)
{
    uint32_t sum = FEED_CHECK_START;
    for (uint32_t i = 0; i < count; i++) {
        sum += bytes[i];
    }
    return (uint8_t)(sum & LOW_BITS);
}

bool feed_take(struct feed_decoder *decoder, uint8_t byte, struct feed_values *values)
{
    if (byte & BEGINS) {
        decoder->count = 0;
    } else if (decoder->count == 0 || decoder->count == FEED_IN_BYTES) {
        return false; /* the rest of a frame whose begin was lost */
    }
    decoder->bytes[decoder->count++] = byte;
    if (decoder->count < FEED_IN_BYTES || byte != check(decoder->bytes, FEED_IN_BYTES - 1)) {
        return false;
    }
    uint32_t word = 0;
    for (uint32_t i = 0; i < FEED_IN_BYTES - 1; i++) {
        word = word << BITS | (decoder->bytes[i] & LOW_BITS);
    }
    values->lines = (uint16_t)(word >> 16);
    values->torque = (uint16_t)word;
    return true;
}

void feed_write(bool closed, uint32_t t_us, uint8_t bytes[FEED_OUT_BYTES])
{
    bytes[0] = (uint8_t)(BEGINS | (closed ? 1U : 0U) << 4 | t_us >> 28);
    for (uint32_t i = 1; i < FEED_OUT_BYTES - 1; i++) {
        bytes[i] = (uint8_t)(t_us >> (BITS * (FEED_OUT_BYTES - 2 - i)) & LOW_BITS);
    }
    bytes[FEED_OUT_BYTES - 1] = check(bytes, FEED_OUT_BYTES - 1);
}
