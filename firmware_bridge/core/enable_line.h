/* The enable line: a state machine of what is received and of time, and nothing else.
 *
 * The line is closed in one state only, and that one is reached from OPEN only: nothing but a
 * heartbeat with enable = 0 lets one with enable = 1 close it, after a reset, a Stop, a silence or a
 * bar. A host that still asks for a closed line, from before, does not get it.
 *
 *            heartbeat 0   heartbeat 1   stop     no heartbeat for timeout   bar      permit
 *   SILENT   OPEN          SILENT        SILENT   SILENT                     BARRED   SILENT
 *   OPEN     OPEN          CLOSED        SILENT   LOST                       BARRED   OPEN
 *   CLOSED   OPEN          CLOSED        SILENT   LOST                       BARRED   CLOSED
 *   LOST     OPEN          LOST          LOST     LOST                       BARRED   LOST
 *   BARRED   BARRED        BARRED        BARRED   BARRED                     BARRED   SILENT
 *
 * It starts SILENT. Not reentrant: all calls come from contexts that do not interrupt each other. */
#ifndef CORE_ENABLE_LINE_H
#define CORE_ENABLE_LINE_H

#include <stdbool.h>
#include <stdint.h>

enum enable_line_state {
    LINE_SILENT, /* open, and a heartbeat with enable = 0 must come first: reset, Stop, bar */
    LINE_OPEN,   /* open: the host lives and wants it so */
    LINE_CLOSED, /* closed: the host lives and wants it so */
    LINE_LOST,   /* as SILENT, but because the host fell silent: status bit 1 */
    LINE_BARRED  /* open: self-test failed, or the host speaks another protocol */
};

struct enable_line {
    enum enable_line_state state;
    uint32_t heartbeat_t_us; /* time of the newest heartbeat */
    uint32_t timeout_us;
};

/* Starts open. */
void enable_line_init(struct enable_line *line, uint32_t timeout_us);

/* A heartbeat came at `t_us`. Judges the time before it first. */
void enable_line_heartbeat(struct enable_line *line, uint32_t t_us, bool enable);

/* The host said Stop, at `t_us`. Judges the time before it first. */
void enable_line_stop(struct enable_line *line, uint32_t t_us);

/* Lets time pass; to be called at least once in 2^31 us. */
void enable_line_judge(struct enable_line *line, uint32_t t_us);

/* Opens the line until enable_line_permit. */
void enable_line_bar(struct enable_line *line);

/* Ends what enable_line_bar began. */
void enable_line_permit(struct enable_line *line);

/* True: the line is to be closed. */
bool enable_line_closed(const struct enable_line *line);

#endif
