/* Which of the numbered frames were lost or corrupt, each counted once (as motord.wire.sequence).
 *
 * A corrupt frame is seen twice: when its checksum fails, and as a gap at the next good one. The
 * larger of the two counts between good frames is what went wrong there. */
#ifndef PROTOCOL_SEQUENCE_H
#define PROTOCOL_SEQUENCE_H

#include <stdbool.h>
#include <stdint.h>

struct sequence_check {
    uint32_t errors;   /* settled */
    uint32_t corrupt;  /* since the last good frame */
    uint16_t expected; /* number of the next frame */
    bool known;        /* `expected` holds */
};

/* Frames lost, corrupt or repeated so far; never falls (but wraps). */
uint32_t sequence_errors(const struct sequence_check *check);

/* Counts a frame that cannot be trusted. */
void sequence_corrupt(struct sequence_check *check);

/* Takes the next frame as the first of a new stream. */
void sequence_restart(struct sequence_check *check);

/* Counts what is missing before a good frame; false if the frame is not to be taken: it repeats
 * the one before, or it steps back (or more than half a turn ahead, which is the same) and
 * `may_restart` is false. With `may_restart` a step back is a sender that started anew. */
bool sequence_accept(struct sequence_check *check, uint16_t number, bool may_restart);

#endif
