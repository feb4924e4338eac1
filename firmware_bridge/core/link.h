/* Frames over the board's link, be it a serial stream or CAN pieces. */
#ifndef CORE_LINK_H
#define CORE_LINK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "boards/board.h"
#include "protocol/can_pieces.h"
#include "protocol/sequence.h"
#include "protocol/stream.h"

/* Receive interrupt only. */
struct link_receiver {
    enum board_link link;
    struct stream_decoder stream;
    struct piece_joiner joiner;
    struct sequence_check check;
};

void link_receiver_init(struct link_receiver *receiver, enum board_link link);

/* Decodes from `data` on and stops after the first thing that ended. Returns the bytes used (CAN:
 * always all); `*what` says what ended, `frame` is written with RECEIVED_FRAME. */
size_t link_receive(struct link_receiver *receiver, const uint8_t *data, size_t count,
                    enum received *what, union bridge_frame *frame);

/* Main loop only. Numbers the frames as they leave. */
struct link_sender {
    enum board_link link;
    uint8_t body[BRIDGE_BODY_MAX];
    uint8_t wire[PIECE_FD_MAX]; /* what is to be sent next */
    uint8_t wire_bytes;         /* of it; 0: nothing */
    uint8_t body_bytes;
    uint8_t offset; /* of the body's bytes in pieces so far */
    uint8_t piece;  /* number of the next piece */
    uint16_t sequence;
};

void link_sender_init(struct link_sender *sender, enum board_link link);

/* Makes `frame` the one to be sent; only when link_send said that the last one is gone. */
void link_load(struct link_sender *sender, union bridge_frame *frame);

/* Sends what is left of the loaded frame. True if nothing is left (or nothing was loaded). */
bool link_send(struct link_sender *sender, bool (*send)(const uint8_t *data, size_t count));

#endif
