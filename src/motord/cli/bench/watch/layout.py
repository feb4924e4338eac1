"""The whole screen as lines of text: what fits into its size, the most important first."""

from rich.text import Text

from motord.api.messages import BenchState
from motord.cli.bench import wording
from motord.cli.bench.watch import keys, panels
from motord.cli.bench.watch.feed import SIGNALS, Snapshot
from motord.cli.bench.watch.glyphs import Glyphs
from motord.cli.bench.watch.panels import row, wrapped

PRECISION_ROWS = 4
QUEUE_ROWS = 2

EVENTS_MIN = 2
SIGNAL_ROWS_MAX = 6
"""Lines of a sparkline on the largest screen; more are given to the events."""


def _plan(state: BenchState, glyphs: Glyphs) -> list[Text]:
    """Return the plan under way, or the last one."""
    p = state.plan
    if p is None:
        return [row("plan", "none since the daemon started")]
    cells = 16
    done = round(cells * min(max(p.fraction, 0.0), 1.0))
    bar = glyphs.bar[0] * done + glyphs.bar[1] * (cells - done)
    most = "at most " if p.targets else ""
    left = "" if p.over else f"  {most}{wording.duration(p.eta_s)} left"
    head = row("plan", (f"{p.plan} {p.state}", "bold"), f"  {bar} {100 * p.fraction:.0f} %{left}")
    if p.over:
        return [head, row("", wording.plan_progress(p))]
    how = "; detached" if p.detached else f"; started by {p.started_by}" if p.started_by else ""
    return [head, row("", f"{p.points_done} of {p.points} points; {p.step or p.state}{how}")]


def _queue(state: BenchState, width: int) -> list[Text]:
    """Return where the queue of plans stands; nothing if it is empty."""
    if state.queue is None or not (state.queue.length or state.queue.active):
        return []
    return wrapped("queue", wording.queue(state.queue), width)[:QUEUE_ROWS]


def _precision(state: BenchState, width: int) -> list[Text]:
    """Return the half-widths that a plan gives by now next to its targets; of others nothing."""
    p = state.plan
    if p is None or not p.targets:
        return []
    known = ((name, p.precision.get(name), target) for name, target in p.targets.items())
    lines = wrapped("precision", ", ".join(_against_target(*one) for one in known), width)
    if p.obstacle:
        lines += wrapped("", f"does not end early: {p.obstacle}", width)
    return lines[:PRECISION_ROWS]


def _against_target(name: str, half_width: float | None, target: float) -> str:
    if half_width is None:
        return f"{name} ? of {target:g}"
    return f"{name} {half_width:.3g} of {target:g}" + " (reached)" * (half_width <= target)


def lines(seen: Snapshot, width: int, height: int, glyphs: Glyphs) -> list[Text]:
    """Return `height` lines of at most `width` cells; what is no longer true for sure is dimmed."""
    title, bottom = panels.title(seen, width, glyphs), [*_message(seen), _footer(width)]
    known = [panels.drive_state(seen, width, glyphs)]
    room = height - 1 - len(bottom)
    if seen.state is not None:
        known += panels.trip(seen.state, width, glyphs) + panels.faults(seen.state, width)
        known += _body(seen, width, room - len(known), glyphs)
    known = [*known, *[Text()] * (room - len(known))][: max(room, 1)]
    if seen.stale:
        for line in known:
            line.stylize("dim")
    whole = [title, *known, *bottom][:height]
    if seen.dialog:
        over = [Text(glyphs.rule * width), *(line.copy() for line in seen.dialog)]
        whole[max(height - len(over), 2) :] = over[: max(height - 2, 0)]
    for line in whole:
        glyphs.cut(line, width)
    return whole


def _message(seen: Snapshot) -> list[Text]:
    """Return what became of the last command; without one, the events have the line."""
    return [Text(seen.message, panels.ALARM if seen.alarming else "bold")] if seen.message else []


def _footer(width: int) -> Text:
    """Return the keys: the capital of each word; the two that lead on where not all have room."""
    line = Text()
    for key in keys.KEYS:
        if key.label:
            line.append(key.label[0], "bold underline").append(f"{key.label[1:]} ")
    line.append("help  (Esc: stop)")
    return line if line.cell_len <= width else Text("Esc: stop, q: quit, ?: all keys")


def _body(seen: Snapshot, width: int, room: int, glyphs: Glyphs) -> list[Text]:
    """Return what is between state and message, as much of it as there is room for."""
    state = seen.state
    assert state is not None
    below = _plan(state, glyphs) + _precision(state, width)
    below += _queue(state, width) + panels.loop(state, width)
    below += panels.devices(state, width) + panels.channels(state, width)
    below += panels.kept(state, width, glyphs)
    below += panels.tracked(state, width)
    spare = room - len(below) - EVENTS_MIN - 1
    rows = min(max(spare // len(SIGNALS), 1), SIGNAL_ROWS_MAX)
    above = panels.signals(seen, width, rows, glyphs)
    above.append(panels.time_axis(seen, width, glyphs))
    for_events = room - len(above) - len(below)
    shown = panels.events(seen, for_events) if for_events > 0 else []
    return above + below + shown
