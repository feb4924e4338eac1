/* The independent watchdog: its own oscillator resets the chip, and so opens the enable line. */
#ifndef STM32F405_WATCHDOG_H
#define STM32F405_WATCHDOG_H

/* Starts it; it cannot be stopped again. 20 ms by the oscillator's nominal 32 kHz (14 to 38 ms over
 * its tolerance of 17 to 47 kHz). It goes on while a debugger holds the chip. */
void watchdog_start(void);

void watchdog_feed(void);

#endif
