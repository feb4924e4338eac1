#include "protocol/stream.h"

#include "protocol/cobs.h"
#include "protocol/codec.h"

_Static_assert(STREAM_STUFFED_MAX <= COBS_MAX + 1, "a stuffed frame needs one code only");

void stream_reset(struct stream_decoder *decoder) { decoder->count = 0; }

enum received stream_take(struct stream_decoder *decoder, uint8_t byte, union bridge_frame *frame)
{
    const uint8_t count = decoder->count;
    if (byte != 0) {
        if (count < STREAM_STUFFED_MAX) {
            decoder->stuffed[count] = byte;
        }
        if (count <= STREAM_STUFFED_MAX) {
            decoder->count++;
        }
        return RECEIVED_NOTHING;
    }
    decoder->count = 0;
    if (count == 0) {
        return RECEIVED_NOTHING;
    }
    if (count > STREAM_STUFFED_MAX) {
        return RECEIVED_CORRUPT;
    }
    const size_t body = cobs_decode(decoder->stuffed, count);
    return frame_unpack(decoder->stuffed, body, frame) ? RECEIVED_FRAME : RECEIVED_CORRUPT;
}

uint8_t stream_write(const uint8_t *body, uint8_t count, uint8_t *wire)
{
    const size_t stuffed = cobs_encode(body, count, wire);
    wire[stuffed] = 0;
    return (uint8_t)(stuffed + 1);
}
