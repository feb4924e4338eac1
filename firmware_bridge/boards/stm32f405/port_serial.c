/* The link on USART1: 8N1, 2 Mbaud. Pins PA9 (transmit) and PA10 (receive). */
#include "clocks.h"
#include "pins.h"
#include "port.h"
#include "program.h"
#include "startup.h"
#include "usart.h"

#define BAUD 2000000U

const enum board_link port_link = BOARD_LINK_SERIAL;

static struct usart usart;

void port_open(void)
{
    RCC->APB2ENR |= RCC_APB2ENR_USART1;
    pins_alternate(GPIOA, 9, 7);
    pins_alternate(GPIOA, 10, 7);
    usart_open(&usart, USART1, APB2_HZ, BAUD);
    irq_enable(IRQ_USART1, PRIORITY_BYTES);
    usart_send(&usart, &(const uint8_t){0}, 1); /* ends a frame that the reset tore, before Hello */
}

bool port_send(const uint8_t *data, size_t count) { return usart_send(&usart, data, count); }

size_t port_take(uint8_t *data) { return usart_take(&usart, data, PORT_CHUNK_MAX); }

void port_push(void) { usart_push(&usart); }

void usart1_handler(void)
{
    usart_interrupt(&usart);
    program_received();
}
