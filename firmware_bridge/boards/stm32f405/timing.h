/* The microsecond clock (TIM5) and the timer interrupt (SysTick). */
#ifndef STM32F405_TIMING_H
#define STM32F405_TIMING_H

#include <stdbool.h>
#include <stdint.h>

/* Starts the clock at 0. `timer_Hz` is what TIM5 is clocked with, whole megahertz: APB1_TIMER_HZ
 * (QEMU clocks it with 1 GHz). */
void timing_start(uint32_t timer_Hz);

/* Microseconds since timing_start, modulo 2^32. */
uint32_t timing_us(void);

/* Lets the timer interrupt come `rate_Hz` times a second from now on. False, and nothing changed,
 * if the timer cannot do that rate: it can from 11 Hz on. */
bool timing_set_rate(uint32_t rate_Hz);

#endif
