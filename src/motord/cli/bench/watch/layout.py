"""The whole screen as lines of text: what fits into its size, the most important first."""

from rich.text import Text

from motord.cli.bench.watch import keys, panels, plan_panel
from motord.cli.bench.watch.glyphs import Glyphs
from motord.cli.bench.watch.history import SIGNALS
from motord.cli.bench.watch.snapshot import Snapshot

EVENTS_MIN = 2
SIGNAL_ROWS_MAX = 6
"""Lines of a sparkline on the largest screen; more are given to the events."""


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
    below = plan_panel.plan(state, glyphs) + plan_panel.precision(state, width)
    below += plan_panel.queue(state, width) + panels.loop(state, width)
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
