/* A clock of 32 bits that wraps. Pure; any context. */
#ifndef CORE_CLOCK_H
#define CORE_CLOCK_H

#include <stdint.h>

/* Microseconds from `then` to `now`, less than 2^32 apart, across any wrap. */
static inline uint32_t clock_since(uint32_t now_us, uint32_t then_us) { return now_us - then_us; }

#endif
