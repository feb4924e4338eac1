/* Checksums. Pure; any context. */
#ifndef PROTOCOL_CRC_H
#define PROTOCOL_CRC_H

#include <stddef.h>
#include <stdint.h>

/* CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF) of `data`; "123456789" gives 0x29B1. */
uint16_t crc16(const uint8_t *data, size_t count);

/* CRC-32 (IEEE 802.3, as zlib's) of `data` after what gave `before`; 0 at the start.
 * "123456789" gives 0xCBF43926. Bit by bit: for use at boot, not in an interrupt. */
uint32_t crc32(uint32_t before, const char *data, size_t count);

#endif
