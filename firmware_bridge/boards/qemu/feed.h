/* What the rig and the emulated board send each other over a UART of their own.
 *
 * A byte with the top bit set begins a frame, so either side is in step again at the next one; all
 * bytes carry seven bits, the highest first. The last is the check: the sum of the bytes before it
 * plus FEED_CHECK_START, modulo 128.
 *
 *   rig to board, 5 bytes   encoder lines (12 bits), torque (16 bits): the ADC's reading times 16,
 *                           which the board takes as 16 conversions with this sum
 *   board to rig, 6 bytes   two zeros, enable line (1 bit, 1 = closed), the board's clock in us
 *                           (32 bits); whenever the line changes, and 100 times a second
 */
#ifndef QEMU_FEED_H
#define QEMU_FEED_H

#include <stdbool.h>
#include <stdint.h>

enum { FEED_IN_BYTES = 5, FEED_OUT_BYTES = 6, FEED_CHECK_START = 0x35 };

struct feed_values {
    uint16_t lines;
    uint16_t torque;
};

struct feed_decoder {
    uint8_t bytes[FEED_IN_BYTES];
    uint8_t count; /* of the frame begun */
};

/* Takes a byte; true if it completes a good frame, which is then in `values`. */
bool feed_take(struct feed_decoder *decoder, uint8_t byte, struct feed_values *values);

/* Writes the board's frame. */
void feed_write(bool closed, uint32_t t_us, uint8_t bytes[FEED_OUT_BYTES]);

#endif
