#include "core/link.h"

#include <string.h>

#include "protocol/codec.h"

void link_receiver_init(struct link_receiver *receiver, enum board_link link)
{
    memset(receiver, 0, sizeof *receiver);
    receiver->link = link;
    stream_reset(&receiver->stream);
    piece_reset(&receiver->joiner);
}

size_t link_receive(struct link_receiver *receiver, const uint8_t *data, size_t count,
                    enum received *what, union bridge_frame *frame)
{
    size_t used = 0;
    if (receiver->link == BOARD_LINK_SERIAL) {
        *what = RECEIVED_NOTHING;
        while (used < count && *what == RECEIVED_NOTHING) {
            *what = stream_take(&receiver->stream, data[used++], frame);
        }
    } else {
        *what = piece_take(&receiver->joiner, data, count, frame);
        used = count;
        if (receiver->joiner.lost) {
            sequence_corrupt(&receiver->check);
        }
    }
    if (*what == RECEIVED_CORRUPT) {
        sequence_corrupt(&receiver->check);
    }
    return used;
}

void link_sender_init(struct link_sender *sender, enum board_link link)
{
    memset(sender, 0, sizeof *sender);
    sender->link = link;
}

/* Makes the next bytes to be sent of what is left of the body. */
static void next(struct link_sender *sender)
{
    if (sender->link == BOARD_LINK_SERIAL) {
        sender->wire_bytes = stream_write(sender->body, sender->body_bytes, sender->wire);
        sender->offset = sender->body_bytes;
    } else {
        const uint8_t most = sender->link == BOARD_LINK_CAN ? PIECE_CLASSIC_MAX : PIECE_FD_MAX;
        sender->wire_bytes = piece_split(sender->body, sender->body_bytes, most, &sender->offset,
                                         &sender->piece, sender->wire);
    }
}

void link_load(struct link_sender *sender, union bridge_frame *frame)
{
    frame->sequence = sender->sequence++;
    sender->body_bytes = (uint8_t)frame_pack(frame, sender->body);
    sender->offset = 0;
}

bool link_send(struct link_sender *sender, bool (*send)(const uint8_t *data, size_t count))
{
    for (;;) {
        if (sender->wire_bytes == 0) {
            if (sender->offset == sender->body_bytes) {
                return true;
            }
            next(sender);
        }
        if (!send(sender->wire, sender->wire_bytes)) {
            return false;
        }
        sender->wire_bytes = 0;
    }
}
