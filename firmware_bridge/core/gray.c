#include "core/gray.h"

uint32_t gray_decode(uint32_t lines)
{
    for (unsigned shift = 16; shift > 0; shift /= 2) {
        lines ^= lines >> shift;
    }
    return lines;
}

uint32_t gray_encode(uint32_t position) { return position ^ position >> 1; }

/* Counts from one position to the other, the short way round. */
static uint32_t distance(const struct gray_filter *filter, uint32_t to, uint32_t from)
{
    const uint32_t ahead = (to - from) & filter->mask;
    const uint32_t behind = (from - to) & filter->mask;
    return ahead < behind ? ahead : behind;
}

void gray_filter_init(struct gray_filter *filter, uint8_t lines)
{
    filter->mask = (1U << lines) - 1U;
    filter->step_max = 1;
    filter->position = 0;
    filter->candidate = 0;
    filter->ticks = 0;
    filter->agreeing = 0;
    filter->acquired = false;
}

void gray_filter_speed(struct gray_filter *filter, uint32_t speed_max_Hz, uint32_t tick_Hz)
{
    const uint64_t counts_Hz = (uint64_t)speed_max_Hz * (filter->mask + 1U);
    filter->step_max = (uint32_t)((counts_Hz + tick_Hz - 1U) / tick_Hz) + 1U;
}

static void accept(struct gray_filter *filter, uint32_t position)
{
    filter->position = position;
    filter->ticks = 0;
    filter->agreeing = 0;
    filter->acquired = true;
}

struct gray_reading gray_filter_take(struct gray_filter *filter, uint32_t lines)
{
    lines &= filter->mask;
    const uint32_t position = gray_decode(lines);
    filter->ticks += filter->ticks <= filter->mask; /* further than a turn away is far enough */
    const uint64_t reach = (uint64_t)filter->step_max * filter->ticks;
    if (filter->acquired && distance(filter, position, filter->position) <= reach) {
        accept(filter, position);
        return (struct gray_reading){lines, true};
    }
    const bool agrees = filter->agreeing > 0 &&
                        distance(filter, position, filter->candidate) <= filter->step_max;
    filter->agreeing = agrees ? filter->agreeing + 1U : 1U;
    filter->candidate = position;
    if (filter->agreeing >= GRAY_AGREEING) {
        accept(filter, position);
        return (struct gray_reading){lines, true};
    }
    if (filter->acquired && filter->ticks <= GRAY_BRIDGED) {
        return (struct gray_reading){gray_encode(filter->position), true};
    }
    return (struct gray_reading){lines, false};
}
