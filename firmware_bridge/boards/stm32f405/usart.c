#include "usart.h"

#define CR1_OPEN (USART_CR1_UE | USART_CR1_RE | USART_CR1_TE | USART_CR1_RXNEIE)

void usart_open(usart *port, usart_registers *registers, uint32_t bus_Hz, uint32_t baud,
                void (*received)(uint8_t byte))
{
    port->registers = registers;
    port->received = received;
    port->overruns = 0;
    port->head = port->tail = 0;
    registers->BRR = (bus_Hz + baud / 2) / baud; /* oversampling by 16: the divider in 1/16 */
    registers->CR1 = CR1_OPEN;
}

bool usart_send(usart *port, const uint8_t *bytes, size_t size)
{
    uint32_t primask = irq_save();
    bool fits = size <= USART_RING_BYTES - (port->head - port->tail);
    if (fits) {
        for (size_t i = 0; i < size; i++) {
            port->ring[(port->head + (uint32_t)i) % USART_RING_BYTES] = bytes[i];
        }
        port->head += (uint32_t)size;
        port->registers->CR1 = CR1_OPEN | USART_CR1_TXEIE;
    }
    irq_restore(primask);
    return fits;
}

static void receive(usart *port)
{
    uint32_t status;
    while ((status = port->registers->SR) & (USART_SR_RXNE | USART_SR_ORE)) {
        uint8_t byte = (uint8_t)port->registers->DR; /* reading SR, then DR, ends the overrun, too */
        port->overruns += (status & USART_SR_ORE) != 0;
        if (status & USART_SR_RXNE) {
            port->received(byte);
        }
    }
}

static void transmit(usart *port)
{
    while (port->head != port->tail && port->registers->SR & USART_SR_TXE) {
        port->registers->DR = port->ring[port->tail % USART_RING_BYTES];
        port->tail++;
    }
    if (port->head == port->tail) {
        port->registers->CR1 = CR1_OPEN;
    }
}

void usart_interrupt(usart *port)
{
    receive(port);
    transmit(port);
}
