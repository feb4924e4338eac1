/* Lets anything happen to a board, for sanitizers: fuzz SEED STEPS. Ends with an abort if the line
 * is closed though no heartbeat asked for it in time. */
#include "host.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint32_t state;

static uint32_t draw(uint32_t below)
{
    state ^= state << 13;
    state ^= state >> 17;
    state ^= state << 5;
    return (uint32_t)((uint64_t)state * below >> 32);
}

static struct bridge bridge;
static uint32_t now_us;
static uint32_t asked_us; /* when a frame was last sent that can close the line */
static uint32_t number; /* of the next frame, and further than its sequence */
static uint8_t piece;

static void receive(const uint8_t *data, size_t count)
{
    /* a copy of exactly this size: reading beyond it is seen */
    uint8_t *copy = malloc(count + (count == 0));
    memcpy(copy, data, count);
    bridge_on_received(&bridge, now_us, copy, count);
    free(copy);
}

static void hurt(uint8_t *bytes, size_t *count)
{
    switch (draw(12)) {
    case 0:
        bytes[draw((uint32_t)*count)] ^= (uint8_t)(1U << draw(8));
        break;
    case 1:
        *count -= draw((uint32_t)*count);
        break;
    case 2:
        bytes[draw((uint32_t)*count)] = (uint8_t)draw(256);
        break;
    default:
        break;
    }
}

static void send_frame(void)
{
    static const uint8_t types[] = {1, 2, 3, 17, 18, 19, 20, 21, 21, 21, 21, 21, 21};
    union bridge_frame frame;
    uint8_t body[BRIDGE_BODY_MAX];
    uint8_t raw[sizeof frame];
    for (size_t i = 0; i < sizeof raw; i++) {
        raw[i] = (uint8_t)draw(256);
    }
    memcpy(&frame, raw, sizeof frame);
    frame.type = types[draw(sizeof types)];
    frame.sequence = (uint16_t)(draw(20) == 0 ? draw(65536) : number++);
    if (frame.type == BRIDGE_Heartbeat) {
        const uint32_t turns = draw(20) == 0 ? draw(128) : number / 65536U;
        frame.Heartbeat.turns_enable = (uint8_t)(turns << 1 | draw(2));
    } else if (frame.type == BRIDGE_HelloRequest) {
        frame.HelloRequest.protocol = (uint16_t)(draw(3) == 0 ? draw(4) : BRIDGE_PROTOCOL);
        number = bridge.heartbeat_next; /* as Hello says */
    } else if (frame.type == BRIDGE_Configure) {
        frame.Configure.rate_Hz = draw(25000);
        frame.Configure.heartbeat_timeout_us = draw(20000);
    }
    asked_us = now_us;
    size_t count = frame_pack(&frame, body);
    if (host_board.link == BOARD_LINK_SERIAL) {
        uint8_t wire[STREAM_STUFFED_MAX + 1];
        count = stream_write(body, (uint8_t)count, wire);
        hurt(wire, &count);
        const size_t cut = draw((uint32_t)count + 1);
        receive(wire, cut);
        receive(wire + cut, count - cut);
        return;
    }
    for (uint8_t offset = 0; offset < count;) {
        uint8_t data[PIECE_FD_MAX];
        const uint8_t most =
            host_board.link == BOARD_LINK_CAN ? PIECE_CLASSIC_MAX : PIECE_FD_MAX;
        size_t bytes = piece_split(body, (uint8_t)count, most, &offset, &piece, data);
        hurt(data, &bytes);
        receive(data, bytes);
    }
}

static void send_noise(void)
{
    uint8_t noise[80];
    const size_t count = draw(sizeof noise + 1);
    for (size_t i = 0; i < count; i++) {
        noise[i] = draw(4) == 0 ? (uint8_t)draw(3) : (uint8_t)draw(256);
    }
    receive(noise, count);
}

static void tick(void)
{
    const size_t count = draw(10) == 0 ? draw(300) : draw(20);
    uint16_t *adc = malloc((count + 1) * sizeof *adc);
    for (size_t i = 0; i < count; i++) {
        adc[i] = (uint16_t)draw(4097);
    }
    now_us += 500;
    const struct board_reading reading = {now_us, draw(3) == 0 ? state : 0, adc, count};
    bridge_on_tick(&bridge, &reading);
    free(adc);
    if (host.line_closed && now_us - asked_us > bridge.line.timeout_us + 500) {
        fprintf(stderr, "the line is closed, and nobody asked for it\n");
        abort();
    }
}

int main(int count, char **arguments)
{
    if (count != 3) {
        return 2;
    }
    state = (uint32_t)strtoul(arguments[1], NULL, 10) * 2654435761U | 1U;
    const unsigned long steps = strtoul(arguments[2], NULL, 10);
    uint32_t closed = 0;
    for (unsigned link = BOARD_LINK_SERIAL; link <= BOARD_LINK_CAN_FD; link++) {
        host_reset((enum board_link)link);
        now_us = 0U - 100000U; /* wraps soon */
        memset(&bridge, 0xA5, sizeof bridge);
        bridge_init(&bridge, &host_board);
        for (unsigned long i = 0; i < steps; i++) {
            switch (draw(8)) {
            case 0:
                send_noise();
                break;
            case 1:
                host.room = draw(3000);
                host.sent_bytes = host.sends = 0;
                bridge_poll(&bridge);
                break;
            case 2:
            case 3:
            case 4:
                send_frame();
                break;
            default:
                tick();
                break;
            }
            closed += host.line_closed;
        }
    }
    printf("%lu\n", (unsigned long)closed);
    return 0;
}
