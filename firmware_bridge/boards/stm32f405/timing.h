/* The microsecond clock (TIM5) and the timer interrupt (SysTick). */
#ifndef STM32F405_TIMING_H
#define STM32F405_TIMING_H

#include <stdbool.h>
#include <stdint.h>

/* Start the clock at 0; the core and bus clocks are set. */
void timing_start(void);

/* Microseconds since `timing_start`, modulo 2^32. */
uint32_t timing_us(void);

/* Let the timer interrupt come `rate_Hz` times a second from now on. False, and nothing changed,
 * if the timer cannot do that rate: it can from 11 Hz on. */
bool timing_set_rate(uint32_t rate_Hz);

#endif
