/* Clock tree: 168 MHz from the crystal (RM0090, 7.2). */
#ifndef STM32F405_CLOCKS_H
#define STM32F405_CLOCKS_H

#include <stdbool.h>

#define CORE_HZ 168000000U
#define APB1_HZ (CORE_HZ / 4)
#define APB1_TIMER_HZ (CORE_HZ / 2)
#define APB2_HZ (CORE_HZ / 2)

/* Set all clocks; false if the crystal or the PLL did not start. The chip then runs on with the
 * internal oscillator, at 168 MHz or at 16 MHz, and must not be relied upon. */
bool clocks_start(void);

#endif
