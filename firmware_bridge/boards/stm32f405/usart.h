/* A USART with a ring to transmit from; what is received goes to a function at once. */
#ifndef STM32F405_USART_H
#define STM32F405_USART_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "registers.h"

#define USART_RING_BYTES 2048U /* power of two */

typedef struct {
    usart_registers *registers;
    void (*received)(uint8_t byte);
    uint32_t overruns; /* bytes lost because nobody read them in time */
    volatile uint32_t head, tail;
    uint8_t ring[USART_RING_BYTES];
} usart;

/* Open a USART whose clock and pins are set; its interrupt calls `usart_interrupt`. */
void usart_open(usart *port, usart_registers *registers, uint32_t bus_Hz, uint32_t baud,
                void (*received)(uint8_t byte));

/* Put all bytes into the ring, or none: false if there is no room. */
bool usart_send(usart *port, const uint8_t *bytes, size_t size);

/* Receive and transmit what can be. From the interrupt; calling it besides does no harm. */
void usart_interrupt(usart *port);

#endif
