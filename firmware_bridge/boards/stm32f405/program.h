/* The program of both boards, the real and the emulated one: interrupts and main loop.
 *
 * Priorities: the port's interrupts come first and only move bytes; the tick (SysTick) and what the
 * bytes mean (PendSV) share the next priority, so that neither interrupts the other. */
#ifndef STM32F405_PROGRAM_H
#define STM32F405_PROGRAM_H

#include "boards/board.h"

enum { PRIORITY_BYTES = 0, PRIORITY_BRIDGE = 1 }; /* 0 comes first */

/* Reads the inputs of a tick: all of struct board_reading but t_us. */
typedef void (*program_read)(struct board_reading *reading);

/* Runs for ever. Clocks, pins and timing have been set up; opens the port. */
void program_run(const struct board *board, program_read read) __attribute__((noreturn));

/* The port has received something. From its interrupt. */
void program_received(void);

#endif
