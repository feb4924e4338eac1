/* Consistent overhead byte stuffing (Cheshire and Baker 1999) of one short frame: any bytes,
 * written without zero, longer by one. Pure; any context. */
#ifndef PROTOCOL_COBS_H
#define PROTOCOL_COBS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { COBS_MAX = 253 }; /* bytes that cobs_encode takes: a longer run needs a second code */

/* Stuffs `count` <= COBS_MAX bytes of `data` into `stuffed`, which has room for count + 1.
 * Returns the bytes written; no delimiter is added. */
size_t cobs_encode(const uint8_t *data, size_t count, uint8_t *stuffed);

/* Undoes it in place. `bytes` is what came between two delimiters, at most COBS_MAX + 1 of it.
 * Returns the bytes that remain, 0 if this is no stuffed frame. */
size_t cobs_decode(uint8_t *bytes, size_t count);

#endif
