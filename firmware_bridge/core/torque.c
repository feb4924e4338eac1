#include "core/torque.h"

struct torque_sample torque_average(const uint16_t *readings, size_t count, uint16_t full_scale)
{
    if (count == 0) {
        return (struct torque_sample){0, false};
    }
    if (count > TORQUE_READINGS_MAX) {
        count = TORQUE_READINGS_MAX;
    }
    uint32_t sum = 0;
    bool valid = true;
    for (size_t i = 0; i < count; i++) {
        sum += readings[i];
        valid = valid && readings[i] > 0 && readings[i] < full_scale;
    }
    const uint32_t doubled = sum * (2U * TORQUE_COUNTS_PER_READING); /* < 2^29 */
    const uint32_t mean = (doubled / (uint32_t)count + 1U) / 2U;
    const int32_t middle = (int32_t)((full_scale + 1U) / 2U * TORQUE_COUNTS_PER_READING);
    return (struct torque_sample){(int32_t)mean - middle, valid};
}
