#include "protocol/cobs.h"

size_t cobs_encode(const uint8_t *data, size_t count, uint8_t *stuffed)
{
    size_t code_at = 0;
    size_t written = 1;
    for (size_t i = 0; i < count; i++) {
        if (data[i] == 0) {
            stuffed[code_at] = (uint8_t)(written - code_at);
            code_at = written;
        } else {
            stuffed[written] = data[i];
        }
        written++;
    }
    stuffed[code_at] = (uint8_t)(written - code_at);
    return written;
}

size_t cobs_decode(uint8_t *bytes, size_t count)
{
    size_t written = 0;
    size_t at = 0;
    while (at < count) {
        const size_t end = at + bytes[at];
        if (end == at || end > count) {
            return 0;
        }
        for (at++; at < end; at++) {
            bytes[written++] = bytes[at];
        }
        if (end < count) {
            bytes[written++] = 0;
        }
    }
    return written;
}
