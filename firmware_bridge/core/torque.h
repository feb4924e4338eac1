/* The torque sensor's voltage, from several ADC readings around one instant. Pure. */
#ifndef CORE_TORQUE_H
#define CORE_TORQUE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    TORQUE_COUNTS_PER_READING = 16, /* one step of the ADC is 16 counts, however many readings */
    TORQUE_READINGS_MAX = 256
};

struct torque_sample {
    int32_t counts; /* mean of the readings above the ADC's middle (full_scale + 1) / 2 */
    bool valid;     /* false: no readings, or one of them at an end of the scale */
};

/* Averages `count` readings, of 0 to `full_scale` each; only the first TORQUE_READINGS_MAX count.
 * Halves are rounded up. Without a reading counts is 0. */
struct torque_sample torque_average(const uint16_t *readings, size_t count, uint16_t full_scale);

#endif
