/* A frame's body in the data fields of CAN frames, one piece in each.
 *
 * First byte of a piece: 0x80 if it is the first of its body, 0x40 if the last, plus its number
 * modulo 64. A sender numbers all its pieces on and on, from body to body, so that a receiver sees
 * every loss, even one that would join the head of one body and the tail of another. The rest is
 * data: up to 7 bytes in classic CAN, up to 63 in CAN FD, whose last piece is filled with zeros up
 * to the next length that CAN FD has; the length of the body follows from its type.
 */
#ifndef PROTOCOL_CAN_PIECES_H
#define PROTOCOL_CAN_PIECES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "protocol/bridge_frames.h"
#include "protocol/stream.h"

enum {
    PIECE_FIRST = 0x80,
    PIECE_LAST = 0x40,
    PIECE_NUMBERS = 64,
    PIECE_CLASSIC_MAX = 8, /* bytes of a piece, its first one included */
    PIECE_FD_MAX = 64
};

/* Writes the piece of `body` (`count` bytes) that begins at `*offset`, numbered `*number`, to
 * `piece`, which has room for `piece_max` bytes (PIECE_CLASSIC_MAX or PIECE_FD_MAX). Moves both on
 * to the next piece; it was the last if `*offset` is then `count`. Returns the bytes written. Pure. */
uint8_t piece_split(const uint8_t *body, uint8_t count, uint8_t piece_max, uint8_t *offset,
                    uint8_t *number, uint8_t *piece);

struct piece_joiner {
    uint8_t body[BRIDGE_BODY_MAX];
    uint8_t size;     /* bytes of the body being joined */
    uint8_t count;    /* of them so far */
    uint8_t expected; /* number of the next piece */
    uint8_t state;    /* between bodies, joining one, or skipping the rest of one given up */
    bool lost;        /* the piece taken last began anew in the middle of a body */
};

/* Starts between two bodies. */
void piece_reset(struct piece_joiner *joiner);

/* Takes the data field of one CAN frame. RECEIVED_CORRUPT: the body of this piece cannot be
 * completed, or is corrupt (reported once for each body). joiner->lost: also, a body before it was
 * not ended. `frame` is written only with RECEIVED_FRAME. One context only. */
enum received piece_take(struct piece_joiner *joiner, const uint8_t *piece, size_t count,
                         union bridge_frame *frame);

#endif
