/* A bridge board in the memory of this machine, for tests, and loops that would be slow in Python. */
#ifndef HOST_H
#define HOST_H

#include "core/bridge.h"
#include "core/enable_line.h"
#include "core/gray.h"
#include "core/link.h"
#include "core/ring.h"
#include "core/self_test.h"
#include "core/torque.h"
#include "protocol/can_pieces.h"
#include "protocol/cobs.h"
#include "protocol/codec.h"
#include "protocol/crc.h"
#include "protocol/sequence.h"
#include "protocol/stream.h"

enum { HOST_SENT_MAX = 65536, HOST_PIECES_MAX = 4096 };

/* What the core did to the board, and how the board answers it. */
struct host {
    bool line_closed;
    uint32_t line_calls;
    uint32_t tick_Hz;
    uint32_t tick_starts; /* calls of set_tick_rate that were obeyed: the period began anew */
    uint32_t tick_max_Hz; /* set_tick_rate refuses more */
    uint32_t feeds;
    bool self_test_result;
    uint32_t room; /* bytes that send still takes */
    uint32_t sends;
    uint32_t sent_bytes;
    uint8_t sent[HOST_SENT_MAX];
    uint16_t send_bytes[HOST_PIECES_MAX]; /* of each send, the first HOST_PIECES_MAX */
};

/* The one board; fill in `board` and clear `host` before bridge_init. */
extern struct host host;
extern struct board host_board;
void host_reset(enum board_link link);

/* Lets ticks come at the rate that the core asked for, one period after `ticked_us` first, none
 * before `now_us` and none after `end_us`, all channels in the middle. Returns when the last came. */
double host_pass(struct bridge *bridge, double ticked_us, double now_us, double end_us,
                 uint32_t lines);

/* How a mutated frame is made of a good one. */
enum mutation {
    FLIP_BITS,  /* 1 to 3 bits of the wire */
    BURST,      /* up to 16 bits in a row, the first and last of them wrong */
    BYTES,      /* 2 to 4 bytes replaced */
    DROP,       /* 1 to 3 bytes left out */
    INSERT,     /* 1 to 3 bytes put in */
    SWAP,       /* two bytes change places */
    SPLICE,     /* the head of one frame, the tail of another */
    MUTATIONS
};

/* Decodes `count` mutated frames, made of random frames of random types. Returns how many
 * were accepted as another frame than was sent. */
uint32_t host_mutated(uint32_t seed, uint32_t count, enum mutation mutation);

/* Decodes the frame with every one, two and three of the bits of `wire` (without delimiter) wrong
 * (`bits` of them). Returns how many were accepted as another frame; `*tried` counts all. */
uint32_t host_flipped(const uint8_t *wire, uint32_t bytes, uint32_t bits, uint32_t *tried);

/* The same of the body, before stuffing: what the CRC says by itself. */
uint32_t host_flipped_body(const uint8_t *body, uint32_t bytes, uint32_t bits, uint32_t *tried);

/* Every burst of up to 16 bits of the first `within` bytes of the body, whatever is inside it,
 * highest bit of a byte first. */
uint32_t host_burst_body(const uint8_t *body, uint32_t bytes, uint32_t within, uint32_t *tried);

#endif
