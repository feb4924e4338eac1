#include "usart.h"

#define CR1_OPEN (USART_CR1_UE | USART_CR1_RE | USART_CR1_TE | USART_CR1_RXNEIE)

void usart_open(struct usart *port, usart_registers *registers, uint32_t bus_Hz, uint32_t baud)
{
    port->registers = registers;
    port->received.head = port->received.tail = 0;
    port->sent.head = port->sent.tail = 0;
    registers->BRR = (bus_Hz + baud / 2) / baud; /* oversampling by 16: the divider in 1/16 */
    registers->CR1 = CR1_OPEN;
}

static uint32_t held(const struct usart_ring *ring) { return ring->head - ring->tail; }

static void put(struct usart_ring *ring, uint8_t byte)
{
    ring->bytes[ring->head % USART_RING_BYTES] = byte;
    __asm volatile("" ::: "memory");
    ring->head++;
}

static uint8_t take(struct usart_ring *ring)
{
    uint8_t byte = ring->bytes[ring->tail % USART_RING_BYTES];
    __asm volatile("" ::: "memory");
    ring->tail++;
    return byte;
}

bool usart_send(struct usart *port, const uint8_t *bytes, size_t count)
{
    if (count > USART_RING_BYTES - held(&port->sent)) {
        return false;
    }
    for (size_t i = 0; i < count; i++) {
        put(&port->sent, bytes[i]);
    }
    uint32_t primask = irq_save();
    port->registers->CR1 = CR1_OPEN | USART_CR1_TXEIE;
    irq_restore(primask);
    return true;
}

size_t usart_take(struct usart *port, uint8_t *bytes, size_t count)
{
    size_t taken = 0;
    while (taken < count && held(&port->received) > 0) {
        bytes[taken++] = take(&port->received);
    }
    return taken;
}

static void receive(struct usart *port)
{
    uint32_t status;
    while ((status = port->registers->SR) & (USART_SR_RXNE | USART_SR_ORE)) {
        uint8_t byte = (uint8_t)port->registers->DR; /* SR, then DR: this ends an overrun, too */
        if (status & USART_SR_RXNE && held(&port->received) < USART_RING_BYTES) {
            put(&port->received, byte);
        }
    }
}

/* Sends one byte, if there is one and the transmitter takes it. */
static bool transmit(struct usart *port)
{
    if (held(&port->sent) == 0) {
        port->registers->CR1 = CR1_OPEN;
        return false;
    }
    if (!(port->registers->SR & USART_SR_TXE)) {
        return false;
    }
    port->registers->DR = take(&port->sent);
    return true;
}

void usart_interrupt(struct usart *port)
{
    receive(port);
    transmit(port);
}

void usart_push(struct usart *port)
{
    bool more = held(&port->sent) > 0;
    while (more) {
        uint32_t primask = irq_save();
        more = transmit(port);
        irq_restore(primask);
    }
}
