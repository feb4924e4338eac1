#include "protocol/crc.h"

uint16_t crc16(const uint8_t *data, size_t count)
{
    uint32_t crc = 0xFFFFU;
    for (size_t i = 0; i < count; i++) {
        /* eight steps of the polynomial x^16 + x^12 + x^5 + 1 at once */
        uint32_t x = (crc >> 8) ^ data[i];
        x ^= x >> 4;
        crc = ((crc << 8) ^ (x << 12) ^ (x << 5) ^ x) & 0xFFFFU;
    }
    return (uint16_t)crc;
}

uint32_t crc32(uint32_t before, const char *data, size_t count)
{
    uint32_t crc = ~before;
    for (size_t i = 0; i < count; i++) {
        crc ^= (uint8_t)data[i];
        for (unsigned bit = 0; bit < 8; bit++) {
            crc = (crc >> 1) ^ (0xEDB88320U & (0U - (crc & 1U)));
        }
    }
    return ~crc;
}
