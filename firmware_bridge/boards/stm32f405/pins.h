/* Pins of the STM32F405 board; README.md has the table. */
#ifndef STM32F405_PINS_H
#define STM32F405_PINS_H

#include <stdbool.h>
#include <stdint.h>

#include "registers.h"

/* Gives a pin to a peripheral: alternate function `function`, with a pull-up. */
void pins_alternate(gpio_registers *port, uint32_t pin, uint32_t function);

/* Sets all other pins: the enable line is driven open before it becomes an output. */
void pins_start(void);

/* The twelve encoder lines, bit 0 the finest: one read of the port. */
uint32_t pins_encoder_lines(void);

void pins_set_enable_line(bool closed);

/* True: the enable line is closed, as seen behind its switch. */
bool pins_enable_line_closed(void);

void pins_set_lamp(bool lit);

/* For an oscilloscope: high while a sample is taken. */
void pins_set_sampling(bool now);

#endif
