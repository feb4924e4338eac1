/* A USART with a ring in each direction. Its interrupt only moves bytes. */
#ifndef STM32F405_USART_H
#define STM32F405_USART_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "registers.h"

enum { USART_RING_BYTES = 2048 }; /* a power of two */

struct usart_ring {
    volatile uint32_t head, tail; /* bytes put in and taken out so far */
    uint8_t bytes[USART_RING_BYTES];
};

struct usart {
    usart_registers *registers;
    struct usart_ring received, sent;
};

/* Opens a USART whose clock and pins are set. */
void usart_open(struct usart *port, usart_registers *registers, uint32_t bus_Hz, uint32_t baud);

/* Puts all bytes into the ring to be sent, or none: false if there is no room. From one context
 * other than the interrupt. */
bool usart_send(struct usart *port, const uint8_t *bytes, size_t count);

/* Takes up to `count` received bytes; returns how many. From one context. Bytes that found no room,
 * or came before the last was read, are lost: the frame's CRC shows it. */
size_t usart_take(struct usart *port, uint8_t *bytes, size_t count);

/* Moves bytes. To be called from the USART's interrupt. */
void usart_interrupt(struct usart *port);

/* Sends what can be sent without waiting for the interrupt: QEMU's USART has no transmit interrupt.
 * From the context of usart_send; needless but harmless on the chip. */
void usart_push(struct usart *port);

#endif
