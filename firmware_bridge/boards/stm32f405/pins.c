#include "pins.h"

#define PIN_ENABLE 6U   /* PC6 */
#define PIN_MONITOR 7U  /* PC7 */
#define PIN_SAMPLING 8U /* PC8 */
#define PIN_LAMP 12U    /* PC12, lit when low */

#define MODE_OUTPUT UINT32_C(1)
#define MODE_ALTERNATE UINT32_C(2)
#define MODE_ANALOG UINT32_C(3)
#define PULL_UP UINT32_C(1)
#define PULL_DOWN UINT32_C(2)
#define SPEED_HIGH UINT32_C(2)

static void set_field(reg *where, uint32_t pin, uint32_t value)
{
    *where = (*where & ~(UINT32_C(3) << (2 * pin))) | value << (2 * pin);
}

void pins_alternate(gpio_registers *port, uint32_t pin, uint32_t function)
{
    reg *selection = pin < 8 ? &port->AFRL : &port->AFRH;
    uint32_t shift = 4 * (pin % 8);
    *selection = (*selection & ~(UINT32_C(0xF) << shift)) | function << shift;
    set_field(&port->OSPEEDR, pin, SPEED_HIGH);
    set_field(&port->PUPDR, pin, PULL_UP);
    set_field(&port->MODER, pin, MODE_ALTERNATE);
}

static void set_high(uint32_t pin, bool high) { GPIOC->BSRR = BIT(high ? pin : pin + 16); }

void pins_start(void)
{
    RCC->AHB1ENR |= RCC_AHB1ENR_GPIOA | RCC_AHB1ENR_GPIOB | RCC_AHB1ENR_GPIOC;
    (void)RCC->AHB1ENR; /* the clock runs two cycles later (errata: delay after enabling) */
    set_high(PIN_ENABLE, false);
    set_high(PIN_SAMPLING, false);
    set_high(PIN_LAMP, true);
    set_field(&GPIOC->MODER, PIN_ENABLE, MODE_OUTPUT);
    set_field(&GPIOC->MODER, PIN_SAMPLING, MODE_OUTPUT);
    set_field(&GPIOC->MODER, PIN_LAMP, MODE_OUTPUT);
    set_field(&GPIOC->PUPDR, PIN_MONITOR, PULL_DOWN); /* without a wire it reads open */
    set_field(&GPIOA->MODER, 1, MODE_ANALOG);
    for (uint32_t pin = 0; pin <= 14; pin++) {
        if (pin < 2 || pin > 4) {
            set_field(&GPIOB->PUPDR, pin, PULL_UP);
        }
    }
}

uint32_t pins_encoder_lines(void)
{
    uint32_t port = GPIOB->IDR;
    return (port & 0x003U) | (port >> 3 & 0xFFCU); /* PB0, PB1; PB5 to PB14 */
}

void pins_set_enable_line(bool closed) { set_high(PIN_ENABLE, closed); }

bool pins_enable_line_closed(void) { return (GPIOC->IDR & BIT(PIN_MONITOR)) != 0; }

void pins_set_lamp(bool lit) { set_high(PIN_LAMP, !lit); }

void pins_set_sampling(bool now) { set_high(PIN_SAMPLING, now); }
