#include "protocol/can_pieces.h"

#include <string.h>

#include "protocol/codec.h"

/* What joiner->state says. */
enum { BETWEEN, JOINING, SKIPPING };

static uint8_t fd_length(uint8_t bytes)
{
    static const uint8_t lengths[] = {12, 16, 20, 24, 32, 48};
    for (size_t i = 0; i < sizeof lengths; i++) {
        if (bytes <= lengths[i]) {
            return bytes <= PIECE_CLASSIC_MAX ? bytes : lengths[i];
        }
    }
    return PIECE_FD_MAX;
}

uint8_t piece_split(const uint8_t *body, uint8_t count, uint8_t piece_max, uint8_t *offset,
                    uint8_t *number, uint8_t *piece)
{
    const uint8_t left = (uint8_t)(count - *offset);
    const uint8_t room = (uint8_t)(piece_max - 1U);
    const bool last = left <= room;
    const uint8_t bytes = last ? left : room;
    const uint8_t length = fd_length((uint8_t)(bytes + 1U));
    piece[0] = (uint8_t)((*offset == 0 ? PIECE_FIRST : 0) | (last ? PIECE_LAST : 0) | *number);
    memcpy(piece + 1, body + *offset, bytes);
    memset(piece + 1 + bytes, 0, (size_t)(length - 1 - bytes));
    *offset = (uint8_t)(*offset + bytes);
    *number = (uint8_t)((*number + 1U) % PIECE_NUMBERS);
    return length;
}

void piece_reset(struct piece_joiner *joiner) { memset(joiner, 0, sizeof *joiner); }

/* A body cannot be completed: an error once; the rest of it, up to its last piece, means nothing. */
static enum received give_up(struct piece_joiner *joiner, bool last)
{
    const bool reported = joiner->state == SKIPPING;
    joiner->state = last ? BETWEEN : SKIPPING;
    return reported ? RECEIVED_NOTHING : RECEIVED_CORRUPT;
}

/* What is in a piece beyond its body has to be the zeros that fill a last piece in CAN FD. */
static bool fills(const uint8_t *filling, size_t count, size_t piece_bytes, bool last)
{
    uint8_t any = 0;
    for (size_t i = 0; i < count; i++) {
        any |= filling[i];
    }
    return count == 0 || (last && piece_bytes > PIECE_CLASSIC_MAX && any == 0);
}

enum received piece_take(struct piece_joiner *joiner, const uint8_t *piece, size_t count,
                         union bridge_frame *frame)
{
    joiner->lost = false;
    if (count < 2 || count > PIECE_FD_MAX) {
        return give_up(joiner, count > 0 && (piece[0] & PIECE_LAST) != 0);
    }
    const bool last = (piece[0] & PIECE_LAST) != 0;
    const uint8_t number = piece[0] % PIECE_NUMBERS;
    if ((piece[0] & PIECE_FIRST) != 0) {
        joiner->lost = joiner->state == JOINING;
        joiner->state = JOINING;
        joiner->count = 0;
        joiner->size = (uint8_t)frame_body_bytes(piece[1]);
    } else if (joiner->state != JOINING || number != joiner->expected) {
        return give_up(joiner, last);
    }
    joiner->expected = (uint8_t)((number + 1U) % PIECE_NUMBERS);
    const size_t room = (size_t)(joiner->size - joiner->count);
    const size_t bytes = count - 1 < room ? count - 1 : room;
    memcpy(joiner->body + joiner->count, piece + 1, bytes);
    joiner->count = (uint8_t)(joiner->count + bytes);
    if (bytes == 0 || (last && bytes < room) ||
        !fills(piece + 1 + bytes, count - 1 - bytes, count, last)) {
        return give_up(joiner, last);
    }
    if (!last) {
        return RECEIVED_NOTHING;
    }
    joiner->state = BETWEEN;
    return frame_unpack(joiner->body, joiner->count, frame) ? RECEIVED_FRAME : RECEIVED_CORRUPT;
}
