/* What a board is to the core: a description and a few functions.
 *
 * Contexts. The board has two interrupts that call into the core (core/bridge.h): the tick timer's
 * and the link's receive interrupt. They must have the SAME priority, so that neither interrupts
 * the other; the core relies on it. The main loop is the third context and may be interrupted
 * anywhere. Each function below says from which of these it is called.
 */
#ifndef BOARDS_BOARD_H
#define BOARDS_BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum board_link {
    BOARD_LINK_SERIAL, /* a stream of bytes */
    BOARD_LINK_CAN,    /* classic CAN: data fields of up to 8 bytes */
    BOARD_LINK_CAN_FD  /* CAN FD: data fields of up to 64 bytes */
};

struct board {
    const char *name;        /* what Hello says; of it at most 16 characters */
    uint32_t serial;         /* number of this specimen, e.g. from the chip's unique id; or 0 */
    uint8_t encoder_lines;   /* Gray code lines, 1 to 24: the encoder has 2^lines counts a turn */
    uint16_t speed_max_Hz;   /* turns a second that the shaft cannot exceed: plausibility */
    uint16_t adc_full_scale; /* the highest reading of the ADC, e.g. 4095; middle is torque zero */
    uint32_t rate_max_Hz;    /* highest sample rate, at most BRIDGE_RATE_MAX_HZ */
    enum board_link link;

    /* Tests what the board can test of itself (clock running, ADC calibrated, line reads open).
     * Called once by bridge_init. False: the enable line stays open for good, status bit 4 says so. */
    bool (*self_test)(void);

    /* Lets the tick interrupt come `tick_Hz` times a second (2000 to 20000, multiples or the same
     * as the sample rate). Called by bridge_init and in the receive interrupt (Configure); the new
     * period begins at once. False if the timer cannot: then the old rate stays. */
    bool (*set_tick_rate)(uint32_t tick_Hz);

    /* Drives the enable line: true closes it. Called by bridge_init (false) and then at every tick
     * and when a received frame changes it, from both interrupts. */
    void (*set_enable_line)(bool closed);

    /* Sends `count` bytes (serial: a whole stuffed frame with its delimiter, at most
     * STREAM_STUFFED_MAX + 1; CAN: one frame's data field, at most 8 or 64). Takes all or nothing:
     * false if there is no room now, and the core comes again with the same bytes at the next
     * bridge_poll. The bytes are copied. Called by bridge_poll, in the main loop. */
    bool (*send)(const uint8_t *data, size_t count);

    /* Puts the hardware watchdog off. Called by bridge_poll, only if the tick interrupt has run
     * since the last time, and t_us with it: so all three have to live. Its time should be 10 to
     * 50 ms. */
    void (*feed_watchdog)(void);
};

/* What the board read at one tick, all at one instant. */
struct board_reading {
    uint32_t t_us;       /* the board's clock at this instant: microseconds, wraps at 2^32 */
    uint32_t lines;      /* encoder lines, bit 0 the finest; one read of the port */
    const uint16_t *adc; /* torque readings around this instant, in any number that serves */
    size_t adc_count;    /* of them, at most 256; 0 if the ADC gave none */
};

#endif
