/* What a board gives to the start-up code, and what that gives to the board. */
#ifndef STM32F405_STARTUP_H
#define STM32F405_STARTUP_H

/* The board's program; called once, does not return. */
void board_main(void);

/* Open the enable line at once, from any context, whatever state the program is in. */
void board_open_line(void);

/* Where the chip starts. */
void reset_handler(void);

/* Faults, a failing crystal (NMI), interrupts that nobody asked for: open the line, reset the chip. */
void fault_handler(void) __attribute__((noreturn));

/* Interrupts that a board may define. */
void systick_handler(void);
void pendsv_handler(void);
void usart1_handler(void);
void usart2_handler(void);
void can1_tx_handler(void);
void can1_rx0_handler(void);

#endif
