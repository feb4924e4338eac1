/* The board that QEMU emulates: an STM32F405 whose encoder lines and torque come over USART2, and
 * whose enable line goes out there. QEMU has neither the chip's pins nor its clock tree, ADC with
 * DMA, watchdog and CAN; start, interrupts, timing and the serial link are those of the real one. */
#include "boards/board.h"

#include "feed.h"
#include "port.h"
#include "program.h"
#include "registers.h"
#include "startup.h"
#include "timing.h"

#define TIMER_HZ 1000000000U /* of all timers in QEMU, whatever the clock tree says */

enum { CONVERSIONS = 16, REPORT_US = 10000 };

static struct feed_decoder decoder;
static volatile uint32_t fed; /* lines << 16 | torque, taken at once */
static volatile bool feeding;
static bool reported_closed;
static uint32_t reported_us;

/* QEMU's USART takes every byte at once. */
static void report(bool closed, uint32_t t_us)
{
    uint8_t bytes[FEED_OUT_BYTES];
    feed_write(closed, t_us, bytes);
    for (uint32_t i = 0; i < FEED_OUT_BYTES; i++) {
        USART2->DR = bytes[i];
    }
    reported_closed = closed;
    reported_us = t_us;
}

void board_open_line(void) { report(false, timing_us()); }

void usart2_handler(void)
{
    struct feed_values values;
    while (USART2->SR & USART_SR_RXNE) {
        if (feed_take(&decoder, (uint8_t)USART2->DR, &values)) {
            fed = (uint32_t)values.lines << 16 | values.torque;
            feeding = true;
        }
    }
}

static bool self_test(void)
{
    uint32_t begin_us = timing_us();
    for (uint32_t turn = 0; turn < 100000; turn++) {
        if (timing_us() - begin_us > 20) {
            return true;
        }
    }
    return false;
}

static void set_enable_line(bool closed)
{
    uint32_t t_us = timing_us();
    if (closed != reported_closed || t_us - reported_us >= REPORT_US) {
        report(closed, t_us);
    }
}

static void feed_watchdog(void) {}

static void read(struct board_reading *reading)
{
    static uint16_t conversions[CONVERSIONS];
    uint32_t word = fed;
    uint32_t torque = word & 0xFFFFU;
    for (uint32_t i = 0; i < CONVERSIONS; i++) {
        conversions[i] = (uint16_t)(torque / CONVERSIONS + (i < torque % CONVERSIONS));
    }
    reading->lines = word >> 16;
    reading->adc = conversions;
    reading->adc_count = feeding ? CONVERSIONS : 0;
}

static struct board board = {
    .name = "qemu-stm32f405",
    .serial = 1,
    .encoder_lines = 12,
    .speed_max_Hz = 200, /* the rig feeds more rarely than the board samples: steps are larger */
    .adc_full_scale = 4095,
    .rate_max_Hz = 20000,
    .self_test = self_test,
    .set_tick_rate = timing_set_rate,
    .set_enable_line = set_enable_line,
    .send = port_send,
    .feed_watchdog = feed_watchdog,
};

void board_main(void)
{
    timing_start(TIMER_HZ);
    USART2->CR1 = USART_CR1_UE | USART_CR1_TE | USART_CR1_RE | USART_CR1_RXNEIE;
    report(false, timing_us());
    irq_enable(IRQ_USART2, PRIORITY_BYTES);
    board.link = port_link;
    program_run(&board, read);
}
