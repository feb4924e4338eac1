#include "core/enable_line.h"

#include "core/clock.h"

void enable_line_init(struct enable_line *line, uint32_t timeout_us)
{
    *line = (struct enable_line){.state = LINE_SILENT, .timeout_us = timeout_us};
}

void enable_line_judge(struct enable_line *line, uint32_t t_us)
{
    const bool alive = line->state == LINE_OPEN || line->state == LINE_CLOSED;
    if (alive && clock_since(t_us, line->heartbeat_t_us) >= line->timeout_us) {
        line->state = LINE_LOST;
    }
}

void enable_line_heartbeat(struct enable_line *line, uint32_t t_us, bool enable)
{
    enable_line_judge(line, t_us);
    line->heartbeat_t_us = t_us;
    if (line->state == LINE_BARRED) {
        return;
    }
    if (!enable) {
        line->state = LINE_OPEN;
    } else if (line->state == LINE_OPEN) {
        line->state = LINE_CLOSED;
    }
}

void enable_line_stop(struct enable_line *line, uint32_t t_us)
{
    enable_line_judge(line, t_us);
    if (line->state == LINE_OPEN || line->state == LINE_CLOSED) {
        line->state = LINE_SILENT;
    }
}

void enable_line_bar(struct enable_line *line) { line->state = LINE_BARRED; }

void enable_line_permit(struct enable_line *line)
{
    if (line->state == LINE_BARRED) {
        line->state = LINE_SILENT;
    }
}

bool enable_line_closed(const struct enable_line *line) { return line->state == LINE_CLOSED; }
