"""The parts of the screen, each as lines of text."""

import math
import textwrap
from collections.abc import Iterable

import numpy as np
from rich.text import Text

from motord.api.messages import BenchState
from motord.cli.bench import wording
from motord.cli.bench.watch.feed import SIGNALS, Snapshot, column_count, column_of
from motord.cli.bench.watch.glyphs import Glyphs, axis_limits, columns_per_character, sparkline

NOW = " now"
LABEL_WIDTH = 13
VALUE_WIDTH = 16
EDGE_WIDTH = 15
EDGES_FROM_WIDTH = 60
"""A narrower screen, where nothing of the edges but their signs had room, has none."""
STATE_STYLE = {
    "OFF": "reverse",
    "READY": "bold black on cyan",
    "ENABLED": "bold black on yellow",
    "TRIPPED": "bold white on red",
}
ALARM = "bold white on red"
HEADING = "dim"
FLOOR = 0.05
"""Least span of a sparkline, as a share of the limit: the noise of a bench at rest stays small."""
TRIP_ROWS = 7
TRACKED_ROWS = 4
CHANNEL_ROWS = 4
MARKS = {"note": "n", "trip": "!"}
"""Kinds of event that are marked below the sparklines."""


def row(label: str, *parts: str | tuple[str, str]) -> Text:
    """Return a line: a label, then text or (text, style)."""
    return Text.assemble((f"{label:<{LABEL_WIDTH}}", HEADING), *parts)


def spread(left: Text, right: Text, width: int, glyphs: Glyphs) -> Text:
    """Return a line with something at its right end; what is left is cut where it would not fit."""
    glyphs.cut(left, max(width - right.cell_len - 1, 0))
    left.pad_right(width - left.cell_len - right.cell_len)
    return left.append_text(right)


def title(seen: Snapshot, width: int, glyphs: Glyphs) -> Text:
    """Return bench, motor, and whether what is shown is the present."""
    state = seen.state
    name = Text(seen.bench, "bold")
    if state is not None:
        name.append(f"  {state.motor}" + ", simulated" * state.simulated, "none")
    if seen.viewer:
        name.append(f"  {seen.viewer}: may only watch")
    if seen.stale:
        since = f"for {wording.duration(seen.age_s)}" if state is not None else "yet"
        said = (f" NO DATA {since}: is the daemon gone? ", f" NO DATA {since} ", " NO DATA ")
        fits = (text for text in said if len(seen.bench) + 1 + len(text) <= width)
        return spread(name, Text(next(fits, said[-1]), ALARM), width, glyphs)
    assert state is not None
    return spread(name, Text(wording.clock(state.t_ns)), width, glyphs)


def drive_state(seen: Snapshot, width: int, glyphs: Glyphs) -> Text:
    """Return the state in a symbol and a word, what is asked of it, and who has the lease."""
    state = seen.state
    if state is None:
        return Text("state unknown")
    known = " (last known)" if seen.stale else ""
    line = Text(f" {glyphs.state[state.state]} {state.state}{known} ", STATE_STYLE[state.state])
    if seen.pending:
        line.append("  ").append(f" {seen.pending} ", ALARM)
    holder = state.lease.holder or "nobody"
    who = Text("lease: ").append("held here" if seen.lease_here else holder, "bold")
    glyphs.cut(who, max(width - line.cell_len - 1, 0))
    if state.fault:
        line.append("  ").append(state.fault, "bold")
    return spread(line, who, width, glyphs)


def trip(state: BenchState, width: int, glyphs: Glyphs) -> list[Text]:
    """Return causes, values with limits, what to do, and the black box; nothing without a trip."""
    if state.state != "TRIPPED":
        return []
    what = [row("cause", (cause, "bold")) for cause in wording.causes(state)]
    what += packed("", map(Text, wording.trip_values(state)), width)
    then: list[Text] = []
    if state.trip is not None:
        then = wrapped("do this", f"{state.trip.action}; then r (reset)", width)
        if state.trip.blackbox:
            then.append(row("black box", end_of(state.trip.blackbox, width - LABEL_WIDTH, glyphs)))
    return what[: max(TRIP_ROWS - len(then), 1)] + then


def wrapped(label: str, text: str, width: int, style: str = "none") -> list[Text]:
    """Return a row whose text goes on below."""
    parts = textwrap.wrap(text, max(width - LABEL_WIDTH, 20))
    return [row(label if number == 0 else "", (part, style)) for number, part in enumerate(parts)]


def faults(state: BenchState, width: int) -> list[Text]:
    """Return what is wrong with parts of the daemon, and what to do; nothing if all is well."""
    lines = wrapped("do this", f"{state.remedy} (key r)", width) if state.remedy else []
    lines += [row("fault", (text, "bold")) for text in state.faults.values()]
    lines += [
        row("process", (f"{name} does not run: {process.exit or 'ended'}", "bold"))
        for name, process in state.processes.items()
        if not process.running
    ]
    if state.realtime and not state.realtime.get("granted", True):
        lines.append(row("real time", "not all rights granted: `motord check --rt` says which"))
    if state.telemetry_dropped:
        lines.append(row("telemetry", f"{state.telemetry_dropped} messages dropped by the daemon"))
    return lines


def signals(seen: Snapshot, width: int, rows: int, glyphs: Glyphs) -> list[Text]:
    """Return value and sparkline of each signal, `rows` lines each."""
    characters = sparkline_width(width)
    columns = characters * columns_per_character(glyphs.braille)
    lows, highs = seen.columns(seen.state.t_ns if seen.state is not None else 0, columns)
    lines: list[Text] = []
    for signal, (low, high) in enumerate(zip(lows, highs, strict=True)):
        scale = seen.scales[signal]
        limits = axis_limits(low, high, FLOOR * scale)
        gap = int(rows > 2)  # between sparklines that would touch
        drawn = sparkline(low, high, limits, rows - gap, braille=glyphs.braille) + [""] * gap
        shown = width >= EDGES_FROM_WIDTH
        edges = (
            _edges(low, high, rows - gap, decimals(scale)) + [""] * gap if shown else [""] * rows
        )
        values = _values(seen.state, signal, decimals(scale))
        for index, (part, edge) in enumerate(zip(drawn, edges, strict=True)):
            label, value = values[index] if index < len(values) else ("", "")
            lines.append(
                Text.assemble(
                    (f"{label:<{LABEL_WIDTH}}", HEADING if index else "none"),
                    (f"{value:<{VALUE_WIDTH}}", "none" if index else "bold"),
                    f"{part:>{characters}}",
                    (edge, HEADING),
                )
            )
    return lines


def sparkline_width(width: int) -> int:
    """Return how many characters of a line of `width` are for a sparkline."""
    edge = EDGE_WIDTH if width >= EDGES_FROM_WIDTH else len(NOW)
    return max(width - LABEL_WIDTH - VALUE_WIDTH - edge, 4)


def decimals(scale: float) -> int:
    """Return decimals for values of up to `scale`: about four digits."""
    return min(max(3 - math.floor(math.log10(scale)), 0), 6) if scale > 0 else 3


def _edges(low: np.ndarray, high: np.ndarray, rows: int, digits: int) -> list[str]:
    """Return greatest and least value, to stand right of the sparkline's lines."""
    if np.isnan(high).all():
        return [""] * rows
    most, least = fixed(float(np.nanmax(high)), digits), fixed(float(np.nanmin(low)), digits)
    if rows == 1:
        return [f" {least}..{most}"]
    return [f" max {most}", *[""] * (rows - 2), f" min {least}"]


def _values(state: BenchState | None, signal: int, digits: int) -> list[tuple[str, str]]:
    """Return label and value for the lines of a signal, the first of them its own."""
    if state is None or state.tick is None:
        return [(SIGNALS[signal].label, "-")]
    tick, wanted = state.tick, state.setpoint
    if signal == 0:
        two = min(max(digits - 1, 2), 4)  # decimals of two torques side by side
        name = "torque" if state.torque_sensor.passes_mean else "torque (AC)"
        ramp = f"{fixed(tick.torque_set_Nm, two)} of {fixed(wanted.target_Nm, two)}"
        return [(name, fixed(tick.torque_Nm, digits, "Nm")), ("  set-point", ramp)]
    if signal == 1:
        held = "not held" if wanted.speed_Hz is None else fixed(wanted.speed_Hz, digits)
        return [("speed", fixed(tick.speed_Hz, digits, "Hz")), ("  set-point", held)]
    phase = signal - 2
    hot_C = tick.brake_temperature_C
    hot = f", {hot_C:.0f} degC" if hot_C is not None else ""
    besides = (
        ("  bus", fixed(tick.u_bus_V, 1, "V")),
        ("  inverter", fixed(tick.temperature_C, 0, "degC")),
        ("  brake", fixed(100 * wanted.brake, 0, "%") + hot),
    )
    return [(SIGNALS[signal].label, fixed(tick.i_A[phase], digits, "A")), besides[phase]]


def fixed(value: float | None, digits: int, unit: str = "") -> str:
    """Return a number with as many decimals, "-" for none; never a minus before zero."""
    if value is None:
        return "-"
    return f"{round(value, digits) + 0.0:.{digits}f} {unit}".rstrip()


def time_axis(seen: Snapshot, width: int, glyphs: Glyphs) -> Text:
    """Return the axis below the sparklines, with a mark at each note (n) and trip (!)."""
    characters, each = sparkline_width(width), columns_per_character(glyphs.braille)
    columns = characters * each
    used = column_count(columns)
    axis = list(f"{glyphs.rule * -(-used // each):>{characters}}")
    now_ns = seen.state.t_ns if seen.state is not None else 0
    for event in seen.events:
        column = column_of(event.t_ns, now_ns, columns)
        if column is not None and event.kind in MARKS:
            behind = (used - 1 - column) // each
            axis[characters - 1 - behind] = MARKS[event.kind]
    left = f"{'':<{LABEL_WIDTH}}{'last 60 s':>{VALUE_WIDTH - 1}} "
    return Text(f"{left}{''.join(axis)}{NOW}", HEADING)


def kept(state: BenchState, width: int, glyphs: Glyphs) -> list[Text]:
    """Return calibration and recording."""
    applied = state.setpoint.compensate
    return [
        row("calibration", f"{wording.calibration(state)}; compensation {applied}"),
        row("recording", end_of(wording.recording(state), width - LABEL_WIDTH, glyphs)),
    ]


def tracked(state: BenchState, width: int) -> list[Text]:
    """Return whether the calibration in force holds; nothing if it is not tracked."""
    if state.tracking is None:
        return []
    style = "bold" if state.tracking.departed else "none"
    text = wording.tracked(state.tracking, state.t_ns)
    return wrapped("tracked", text, width, style)[:TRACKED_ROWS]


def end_of(path: str, room: int, glyphs: Glyphs) -> str:
    """Return as much of the end of a path as there is room for: its name says most."""
    return path if len(path) <= room else glyphs.ellipsis + path[len(path) - max(room - 1, 0) :]


def packed(label: str, parts: Iterable[Text], width: int, between: str = "; ") -> list[Text]:
    """Return a row with as many parts on each line as it takes."""
    lines: list[Text] = []
    for part in parts:
        if lines and lines[-1].cell_len + part.cell_len + len(between) <= width:
            lines[-1].append(between).append_text(part)
        else:
            lines.append(row("" if lines else label).append_text(part))
    return lines


def loop(state: BenchState, width: int) -> list[Text]:
    """Return the timing of the loop."""
    return packed("loop", map(Text, wording.loop(state).split("; ")), width)


def devices(state: BenchState, width: int) -> list[Text]:
    """Return how old each signal is, errors of the links, and health of the slow devices."""
    ages = [Text(f"{name} {wording.number(1e3 * age_s)}") for name, age_s in state.ages.items()]
    parts: list[Text] = []
    bridge: list[Text] = []
    if (links := state.links) is not None:
        style = "bold" if links.errors_last_s > 0 else "none"
        parts.append(Text(f"link errors {links.errors}", style))
        parts += [Text("bus off", "bold")] * links.bus_off
        bridge = wrapped("bridge", links.bridge, width, "bold")
    for name, device in (("brake", state.brake), ("drive", state.drive)):
        why = f" ({device.error})" if device.error else ""
        if device.health != "none":
            style = "bold" if device.health in ("failing", "stale") else "none"
            parts.append(Text(f"{name} {device.health}{why}", style))
    shown_ages = packed("ages, ms", ages or [Text("-")], width, ", ")
    return shown_ages + packed("devices", parts or [Text("-")], width) + bridge


def channels(state: BenchState, width: int) -> list[Text]:
    """Return the slow channels, those that are not ok first, as many on a line as it takes."""
    parts: list[Text] = []
    for one in sorted(state.channels, key=lambda one: one.status == "ok"):
        shown = f"{wording.number(one.value)} {one.unit}".rstrip()
        text, style = (shown, "none") if one.status == "ok" else (wording.channel(one), "bold")
        parts.append(Text(f"{one.name} {text}", style))
    return packed("channels", parts, width)[:CHANNEL_ROWS]


def events(seen: Snapshot, rows: int) -> list[Text]:
    """Return the newest events, the newest last, or as far back as was scrolled."""
    end = max(len(seen.events) - seen.events_back, min(rows, len(seen.events)))
    lines = []
    for event in seen.events[max(end - rows, 0) : end]:
        style = "bold" if event.kind in ("trip", "fault", "note") else "none"
        text = " ".join(event.message.split())
        lines.append(
            Text.assemble(
                (f"{wording.clock(event.t_ns)}  ", HEADING), (event.kind, style), f": {text}"
            )
        )
    return lines
