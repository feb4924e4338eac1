/* The interrupts and the main loop as two threads that truly run at once, for the thread sanitizer:
 * threads SAMPLES. Every sample must arrive once, in order, or be counted as dropped. */
#include "host.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct bridge bridge;
static uint32_t samples;
static atomic_bool ended;

/* The interrupts: the only one who calls bridge_on_tick and bridge_on_received. */
static void *interrupts(void *unused)
{
    union bridge_frame frame = {.Start = {BRIDGE_Start, 0}};
    uint8_t body[BRIDGE_BODY_MAX];
    uint8_t wire[STREAM_STUFFED_MAX + 1];
    (void)unused;
    size_t count = stream_write(body, (uint8_t)frame_pack(&frame, body), wire);
    bridge_on_received(&bridge, 0, wire, count);
    frame.type = BRIDGE_Heartbeat;
    frame.Heartbeat.turns_enable = 1;
    const uint16_t adc[] = {2048};
    for (uint32_t i = 1; i <= 2 * samples; i++) {
        const struct board_reading reading = {i * 500, 0, adc, 1};
        frame.sequence++;
        count = stream_write(body, (uint8_t)frame_pack(&frame, body), wire);
        bridge_on_received(&bridge, i * 500, wire, count);
        bridge_on_tick(&bridge, &reading);
    }
    atomic_store(&ended, true);
    return NULL;
}

static struct stream_decoder decoder;
static uint32_t arrived;
static uint32_t wrong;

/* What the main loop sends, straight into a decoder. */
static bool send(const uint8_t *data, size_t count)
{
    static uint32_t last_us;
    static uint16_t next;
    union bridge_frame frame;
    for (size_t i = 0; i < count; i++) {
        if (stream_take(&decoder, data[i], &frame) != RECEIVED_FRAME) {
            continue;
        }
        wrong += frame.sequence != next++;
        if (frame.type == BRIDGE_Sample) {
            wrong += frame.Sample.t_us <= last_us || frame.Sample.t_us % 1000 != 0;
            last_us = frame.Sample.t_us;
            arrived++;
        }
    }
    return true;
}

int main(int count, char **arguments)
{
    pthread_t thread;
    if (count != 2) {
        return 2;
    }
    samples = (uint32_t)strtoul(arguments[1], NULL, 10);
    host_reset(BOARD_LINK_SERIAL);
    host_board.send = send;
    bridge_init(&bridge, &host_board);
    if (pthread_create(&thread, NULL, interrupts, NULL) != 0) {
        return 3;
    }
    while (!atomic_load(&ended)) {
        bridge_poll(&bridge);
    }
    pthread_join(thread, NULL);
    bridge_poll(&bridge);
    printf("%lu %lu %lu\n", (unsigned long)wrong, (unsigned long)arrived,
           (unsigned long)bridge.dropped);
    return 0;
}
