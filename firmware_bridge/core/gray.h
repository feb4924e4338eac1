/* Gray code, and a filter that knows how fast a shaft can turn. One context only. */
#ifndef CORE_GRAY_H
#define CORE_GRAY_H

#include <stdbool.h>
#include <stdint.h>

enum {
    GRAY_LINES_MAX = 24,
    GRAY_BRIDGED = 3,  /* implausible readings in a row for which the last good one stands in */
    GRAY_AGREEING = 16 /* readings in a row that agree with each other make a position */
};

/* Position 0 to 2^24 - 1 of a reflected Gray code; and back. Pure. */
uint32_t gray_decode(uint32_t lines);
uint32_t gray_encode(uint32_t position);

struct gray_filter {
    uint32_t mask;       /* 2^lines - 1 */
    uint32_t step_max;   /* counts that the shaft turns between two readings at most */
    uint32_t position;   /* last good one */
    uint32_t candidate;  /* last reading that was not plausible */
    uint32_t ticks;      /* readings since `position`; 0: it is the newest */
    uint32_t agreeing;   /* readings in a row that agree with `candidate` */
    bool acquired;       /* `position` holds */
};

struct gray_reading {
    uint32_t lines; /* good ones: as read, or the last good ones in place of a glitch */
    bool valid;     /* false: no position; `lines` as read */
};

/* `lines`: 1 to GRAY_LINES_MAX. */
void gray_filter_init(struct gray_filter *filter, uint8_t lines);

/* Says how far the shaft gets between two readings: a turn's counts * speed_max_Hz / tick_Hz,
 * rounded up, and one more for the edge. */
void gray_filter_speed(struct gray_filter *filter, uint32_t speed_max_Hz, uint32_t tick_Hz);

/* Takes the reading of a tick. A reading is plausible if the shaft can have got there since the
 * last good one. Up to GRAY_BRIDGED implausible readings in a row are glitches, and the last good
 * one is reported; then the encoder is invalid until readings are plausible again, or GRAY_AGREEING
 * in a row agree among themselves. */
struct gray_reading gray_filter_take(struct gray_filter *filter, uint32_t lines);

#endif
