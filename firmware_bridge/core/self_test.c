#include "core/self_test.h"

#include <stdint.h>
#include <string.h>

#include "core/enable_line.h"
#include "core/gray.h"
#include "protocol/cobs.h"
#include "protocol/codec.h"
#include "protocol/crc.h"

static bool checksums(void)
{
    static const char digits[] = "123456789";
    uint8_t bytes[9];
    memcpy(bytes, digits, sizeof bytes);
    const bool short_one = crc16(bytes, sizeof bytes) == 0x29B1U;
    const bool long_one = crc32(0, digits, sizeof bytes) == 0xCBF43926U;
    return short_one & long_one;
}

static bool frames(void)
{
    const union bridge_frame sent = {
        .Sample = {BRIDGE_Sample, 0x1234, 0xFEDCBA98U, 0x00A5C3U, -123456, 0x8001}};
    union bridge_frame got;
    uint8_t body[BRIDGE_BODY_MAX];
    uint8_t stuffed[BRIDGE_BODY_MAX + 1];
    memset(&got, 0, sizeof got);
    const size_t bytes = frame_pack(&sent, body);
    const size_t unstuffed = cobs_decode(stuffed, cobs_encode(body, bytes, stuffed));
    const bool whole = frame_unpack(stuffed, unstuffed, &got);
    stuffed[5] ^= 0x10U;
    const bool torn_refused = !frame_unpack(stuffed, unstuffed, &got);
    return whole & torn_refused & (got.Sample.t_us == sent.Sample.t_us) &
           (got.Sample.torque_counts == sent.Sample.torque_counts) &
           (got.Sample.status == sent.Sample.status);
}

static bool gray(void)
{
    uint32_t wrong = 0;
    for (uint32_t position = 0; position < 4096; position += 273) {
        wrong |= gray_decode(gray_encode(position)) ^ position;
    }
    return wrong == 0;
}

static bool line(void)
{
    struct enable_line line;
    enable_line_init(&line, 1000);
    enable_line_heartbeat(&line, 0xFFFFFF00U, true);
    const bool open_first = !enable_line_closed(&line);
    enable_line_heartbeat(&line, 0xFFFFFF00U, false);
    enable_line_heartbeat(&line, 0xFFFFFF00U, true);
    enable_line_judge(&line, 0x2E7U); /* 999 us later, across the wrap */
    const bool in_time = enable_line_closed(&line);
    enable_line_judge(&line, 0x2E8U);
    const bool open_then = !enable_line_closed(&line);
    return open_first & in_time & open_then;
}

/* Without short cuts, so that every part runs every time. */
bool self_test(void) { return checksums() & frames() & gray() & line(); }
