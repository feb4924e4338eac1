/* The STM32F405 board. */
#include "boards/board.h"

#include "adc.h"
#include "clocks.h"
#include "pins.h"
#include "port.h"
#include "program.h"
#include "startup.h"
#include "timing.h"
#include "watchdog.h"

#define RATE_MAX_SERIAL_HZ 8000U /* 21 bytes a sample at 2 Mbaud, and Status */
#define RATE_MAX_CAN_HZ 1500U    /* 3 frames a sample at 1 Mbit/s, heartbeats against them */

#define SLOW_BLINK_US 19 /* bit of the clock: on and off for 0.52 s each */
#define FAST_BLINK_US 16 /* 0.07 s each */

extern const uint32_t chip_number[3]; /* its place is in stm32f405.ld */

static bool clocks_good;
static bool tested_good;
static bool line_closed;

void board_open_line(void) { pins_set_enable_line(false); }

static bool self_test(void)
{
    uint16_t conversions[ADC_OVERSAMPLING];
    uint32_t begin_us = timing_us();
    adc_start();
    bool clock_runs = false;
    for (uint32_t turn = 0; turn < 100000 && !clock_runs; turn++) {
        clock_runs = timing_us() - begin_us > 2 * ADC_OVERSAMPLING;
    }
    bool converted = adc_latest(conversions);
    pins_set_enable_line(false);
    tested_good = clocks_good && clock_runs && converted && !pins_enable_line_closed();
    return tested_good;
}

static void set_enable_line(bool closed)
{
    pins_set_enable_line(closed);
    line_closed = closed;
}

static void feed_watchdog(void)
{
    watchdog_feed();
    bool blink = (timing_us() >> (tested_good ? SLOW_BLINK_US : FAST_BLINK_US) & 1) != 0;
    pins_set_lamp(line_closed || blink);
}

static void read(struct board_reading *reading)
{
    static uint16_t conversions[ADC_OVERSAMPLING];
    pins_set_sampling(true);
    reading->lines = pins_encoder_lines();
    reading->adc = conversions;
    reading->adc_count = adc_latest(conversions) ? ADC_OVERSAMPLING : 0;
    pins_set_sampling(false);
}

static struct board board = {
    .name = "stm32f405",
    .encoder_lines = 12,
    .speed_max_Hz = 50,
    .adc_full_scale = 4095,
    .self_test = self_test,
    .set_tick_rate = timing_set_rate,
    .set_enable_line = set_enable_line,
    .send = port_send,
    .feed_watchdog = feed_watchdog,
};

void board_main(void)
{
    pins_start();
    clocks_good = clocks_start();
    RCC->AHB1ENR |= RCC_AHB1ENR_DMA2;
    RCC->APB1ENR |= RCC_APB1ENR_TIM5;
    RCC->APB2ENR |= RCC_APB2ENR_ADC1;
    (void)RCC->APB2ENR;
    timing_start(APB1_TIMER_HZ);
    board.link = port_link;
    board.rate_max_Hz = port_link == BOARD_LINK_SERIAL ? RATE_MAX_SERIAL_HZ : RATE_MAX_CAN_HZ;
    board.serial = chip_number[0] ^ chip_number[1] ^ chip_number[2];
    watchdog_start();
    program_run(&board, read);
}
