"""The screen as lines: what is on it, in which size."""

import numpy as np
import pytest

from motord.api.descriptions import HANGING_REMEDY, LOOP_SILENT, bridge_action
from motord.api.messages import Event
from motord.cli.bench.watch import layout
from motord.cli.bench.watch.feed import MinMaxHistory, Snapshot
from motord.cli.bench.watch.glyphs import ASCII, UNICODE
from motord.schema import BridgeStatus
from tests.unit.cli.watch.samples import LINKS, NOW_NS, PLAN, TRIP, no_columns, state, ticks

EVENTS = [
    Event(t_ns=NOW_NS - 50_000_000_000, kind="state", message="READY -> ENABLED"),
    Event(t_ns=NOW_NS - 30_000_000_000, kind="note", message="brake squeals"),
    Event(t_ns=NOW_NS - 1_000_000_000, kind="missed", message="the loop skipped 3 ticks"),
]


def snapshot(bench_state, **changes):
    whole = {
        "bench": "bench1", "state": bench_state, "age_s": 0.05,
        "events": EVENTS, "columns": no_columns,
        "scales": (6.0, 4.0, 25.0, 25.0, 25.0),
    }  # fmt: skip
    return Snapshot(**{**whole, **changes})


def shown(seen, width=80, height=24, glyphs=UNICODE):
    """Return the lines as text, all of which fit."""
    drawn = layout.lines(seen, width, height, glyphs)
    assert len(drawn) == height
    assert all(line.cell_len <= width for line in drawn)
    return [line.plain for line in drawn]


def has(lines, *words):
    assert all(any(word in line for line in lines) for word in words), "\n".join(lines)


def test_all_of_it_fits_into_80_by_24():
    lines = shown(snapshot(state(plan=PLAN)))
    has(
        lines,
        "bench1  axial-flux 48/16 sim-1, simulated",
        "● ENABLED",
        "lease: anna@bench pts/3 4711",
        "3.013 Nm",
        "3.00 of 3.00",
        "0.700 Hz",
        "12.25 A",
        "24.0 V",
        "41 degC",
        "40 %, 63 degC",
        "calibrate running  ███████░░░░░░░░░ 43 %  3.2 min left",
        "12 of 28 points; 3 Nm, 0.7 Hz: capturing",
        "10000 Hz, missed 3; late p50 12 p99 31 max 80 us, work p99 55 us",
        "ages, ms     encoder 0.3, currents 0.9, brake 50",
        "devices      link errors 4; brake ok",
        "3fa2c1, joint, 2 days old; compensation on",
        "/runs/bench1-calibrate.mcap.part",
        "note: brake squeals",
        "missed: the loop skipped 3 ticks",
        "Stop Pause Abort Note Reset Lease Enable Disable Torque Quit ? help",
    )


def test_a_queue_that_is_not_empty_has_a_line():
    waits = {"state": "waiting", "length": 3, "message": "waits until 06:00", "eta_s": 7200.0}
    lines = shown(snapshot(state(plan=PLAN, queue=waits)))
    has(lines, "queue        waiting: waits until 06:00; 3 plans, about 2.0 h")
    empty = shown(snapshot(state(plan=PLAN, queue={})))
    assert not any(line.startswith("queue") for line in empty)


def test_a_plan_with_targets_shows_how_precise_it_is_by_now():
    targets = {"alpha_percent": 0.1, "beta_A": 0.02, "cogging_percent": 1.0, "ripple_percent": 0.2}
    known = {"alpha_percent": 0.1234, "beta_A": 0.02, "cogging_percent": 1.01}
    plan = {**PLAN, "targets": targets, "precision": known}
    lines = shown(snapshot(state(plan=plan)))
    has(lines, "43 %  at most 3.2 min left", "precision    alpha_percent 0.123 of 0.1, beta_A")
    stated = " ".join(line[13:].strip() for line in lines if " of " in line)
    assert "beta_A 0.02 of 0.02 (reached), cogging_percent 1.01 of 1, ripple_percent ?" in stated
    has(lines, "missed: the loop skipped 3 ticks")
    obstacle = "the model does not fit: " + "x" * 900
    many = shown(snapshot(state(plan={**plan, "obstacle": obstacle})))
    has(many, "does not end early: the model does not fit", "recording    /runs")


def test_a_trip_is_shown_with_value_limit_and_what_to_do_and_nothing_else_is_lost():
    lines = shown(snapshot(state(plan=PLAN, **TRIP)))
    has(lines, "✕ TRIPPED", "speed: 25.7 rad/s, limit 25 rad/s", "black box    /runs/blackbox.mcap")
    causes = [line for line in lines if "OVER_" in line]
    assert causes[0].startswith("cause        OVER_SPEED: the rotor turned faster")  # the first
    advice = " ".join(line[13:].strip() for line in lines[5:8])
    assert "check that the brake answers and holds" in advice
    assert "then r (reset)" in advice
    has(lines, "current c", "calibrate running", "recording", "missed: the loop")


@pytest.mark.parametrize("name", ["OFF", "READY", "ENABLED", "TRIPPED"])
@pytest.mark.parametrize("glyphs", [UNICODE, ASCII])
def test_the_state_is_a_symbol_and_a_word(name, glyphs):
    assert f" {glyphs.state[name]} {name} " in shown(snapshot(state(state=name)), glyphs=glyphs)[1]


def test_a_long_holder_leaves_room_for_the_state_and_what_becomes_of_a_command():
    lease = {"holder": "h" * 64, "remaining_s": 1.5, "duration_s": 2.0}
    seen = snapshot(state(lease=lease, fault="f" * 90), age_s=3.0, pending="stopping...")
    line = shown(seen)[1]
    assert line.startswith(" ● ENABLED (last known)    stopping...")
    assert "lease: hhh" in line


def test_in_ascii_all_of_it_is_ascii():
    history = MinMaxHistory()
    history.add(ticks(60.0, 2.0))
    seen = snapshot(state(plan=PLAN, **TRIP), columns=history.columns)
    assert "".join(shown(seen, glyphs=ASCII)).isascii()
    assert "".join(shown(snapshot(None), glyphs=ASCII)).isascii()


@pytest.mark.parametrize("glyphs", [UNICODE, ASCII])
def test_a_line_that_is_cut_says_so(glyphs):
    lines = shown(snapshot(state(plan=PLAN)), width=40, glyphs=glyphs)
    cut = [line for line in lines if line.startswith(("calibration", "             late"))]
    assert [line[-1] for line in cut] == [glyphs.ellipsis] * 2, lines
    narrower = shown(snapshot(state(plan=PLAN)), width=30, glyphs=glyphs)
    assert "speed        0.700 Hz" in narrower  # only blanks are cut off


def test_a_trip_of_many_causes_says_what_to_do_and_every_value_is_whole():
    trips = [{"name": f"CAUSE_{n}", "meaning": "a cause of it"} for n in range(9)]
    values = {f"age of the feedback {n}, s": {"value": 0.25, "limit": 0.05} for n in range(2)}
    many = state(**{**TRIP, "trips": trips, "trip": {**TRIP["trip"], "values": values}})
    has(shown(snapshot(many)), "CAUSE_0", "do this", "then r (reset)", "black box")
    two = state(**{**TRIP, "trips": trips[:2], "trip": {**TRIP["trip"], "values": values}})
    has(shown(snapshot(two)), *(f"age of the feedback {n}: 0.25 s, limit 0.05 s" for n in range(2)))


def test_long_ages_of_all_signals_are_on_80_by_24():
    names = ("tick", "encoder", "torque", "inverter", "heartbeat", "brake", "drive")
    lines = shown(snapshot(state(plan=PLAN, ages=dict.fromkeys(names, 0.0123))))
    has(lines, *(f"{name} 12.3" for name in names))


@pytest.mark.parametrize("rows", [24, 34, 60])
def test_a_spike_of_one_tick_is_seen_with_its_value(rows):
    block = ticks(60.0, 1.0)
    block["torque_Nm"][30_000] = 5.875
    with_spike, without = MinMaxHistory(), MinMaxHistory()
    with_spike.add(block)
    without.add(ticks(60.0, 1.0))
    lines = shown(snapshot(state(), columns=with_spike.columns), height=rows)
    assert "max 5.875" in lines[2]
    assert lines[2] != shown(snapshot(state(), columns=without.columns), height=rows)[2]


def test_more_space_is_used_by_sparklines_and_events():
    many = [Event(t_ns=NOW_NS, kind="state", message=f"number {n}") for n in range(100)]
    small = shown(snapshot(state(), events=many))
    large = shown(snapshot(state(), events=many), 160, 60)
    assert sum("number" in line for line in small) == 4
    assert sum("number" in line for line in large) > 10
    distance = [
        [n for n, line in enumerate(lines) if line.startswith(("torque", "speed"))]
        for lines in (small, large)
    ]
    assert np.diff(distance[1]) > np.diff(distance[0])


def test_events_scroll():
    many = [Event(t_ns=NOW_NS, kind="state", message=f"number {n}.") for n in range(100)]
    has(shown(snapshot(state(), events=many, events_back=50)), "number 49.")
    first = shown(snapshot(state(), events=many, events_back=1000))
    has(first, "number 0.", "number 3.")


def test_notes_and_trips_are_marked_below_the_sparklines():
    axis = next(line for line in shown(snapshot(state())) if "last 60 s" in line)
    assert axis.count("n") == 2  # the mark and "now"
    assert axis.index("n") < len(axis) - 10


def test_what_is_not_the_present_is_said_to_be_so():
    seen = snapshot(state(), age_s=3.0)
    lines = shown(seen)
    has(lines, "NO DATA for 3 s: is the daemon gone?", "● ENABLED (last known)", "3.013 Nm")
    drawn = layout.lines(seen, 80, 24, UNICODE)
    assert all(
        any(span.style == "dim" for span in line.spans) for line in drawn[1:-2] if line.plain
    )
    has(shown(snapshot(None)), "NO DATA yet")


@pytest.mark.parametrize(
    ("width", "said"),
    [(80, "NO DATA for 3 s: is the daemon gone?"), (40, "NO DATA for 3 s"), (20, "NO DATA")],
)
def test_a_silent_bench_is_named_however_narrow_the_screen_is(width, said):
    bench = "bench-in-hall-2" if width > 20 else "bench"
    seen = snapshot(state(), age_s=3.0, bench=bench)
    first = layout.lines(seen, width, 24, UNICODE)[0].plain
    assert first.startswith(bench)
    assert first.rstrip().endswith(said)
    assert len(first) == width


def test_before_the_first_tick_there_are_no_values():
    has(shown(snapshot(state(tick=None))), "torque       -")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"faults": {"publisher": "publisher: no memory"}}, "fault        publisher: no memory"),
        ({"fault": "the loop ended", "state": "OFF"}, "the loop ended"),
        (
            {"fault": LOOP_SILENT, "remedy": HANGING_REMEDY},
            f"do this      {HANGING_REMEDY} (key r)",
        ),
        (
            {"processes": {"loop": {"pid": None, "running": False, "restarts": 0, "exit": "9"}}},
            "process      loop does not run: 9",
        ),
        ({"realtime": {"granted": False}}, "motord check --rt"),
        ({"telemetry_dropped": 5}, "telemetry    5 messages dropped"),
        ({"links": {**LINKS, "bus_off": True}}, "link errors 4; bus off; brake ok"),
        ({"brake": {"health": "stale", "error": "no answer"}}, "brake stale (no answer)"),
        ({"calibration": None}, "calibration  none"),
        ({"recording": {"recording": False, "path": "", "obstacle": "disk full"}}, "disk full"),
        ({"torque_sensor": {"highpass_time_constant_s": 2.0}}, "torque (AC)"),
        (
            {"plan": {**PLAN, "state": "failed", "message": "it tripped"}},
            "12 of 28 points: it trip",
        ),
    ],
)
def test_what_is_wrong_is_on_the_screen(changes, words):
    has(shown(snapshot(state(**changes))), words)


def test_what_to_do_about_a_bridge_board_is_not_cut_off():
    lines = shown(snapshot(state(links={**LINKS, "bridge": bridge_action(BridgeStatus.BARRED)})))
    said = " ".join(line[13:].strip() for line in lines)
    assert bridge_action(BridgeStatus.BARRED) in said


@pytest.mark.parametrize("size", [(1, 1), (20, 2), (40, 3), (40, 10), (79, 23), (300, 100)])
@pytest.mark.parametrize("changes", [{}, TRIP])
def test_any_size_will_do(size, changes):
    lines = shown(snapshot(state(**changes)), *size)
    if size[1] > 2 and size[0] > 20:
        assert "ENABLED" in lines[1] or "TRIPPED" in lines[1]


def test_text_of_others_is_text():
    shown(snapshot(state(fault="[red]not markup[/red]"), message="[bold]x"))
    assert "[red]not markup" in shown(snapshot(state(fault="[red]not markup")))[1]


def test_of_a_long_path_the_end_is_shown():
    path = "/var/lib/motord/" + "x" * 60 + "/bench1-calibrate.mcap.part"
    lines = shown(snapshot(state(recording={"recording": True, "path": path})))
    has(lines, "recording    …", "/bench1-calibrate.mcap.part")


TRACKED = {
    "name": "alpha_a", "meaning": "the gain of phase a", "unit": "", "value": 1.0213,
    "half_width": 0.0042, "in_force": 1.0021, "in_force_half_width": 0.005, "departed": False,
}  # fmt: skip


@pytest.mark.parametrize(
    ("tracking", "line"),
    [
        ({"quantities": [TRACKED], "turns": 70}, "tracked      1 quantities hold over 70 turns"),
        ({"quantities": [{**TRACKED, "departed": True}]},
         "tracked      departed: alpha_a 1.0213 +- 0.0042, in force 1.0021 +- 0.0050"),
        ({"obstacle": "too few turns"}, "tracked      too few turns"),
        ({}, "tracked      nothing known yet"),
    ],
)  # fmt: skip
def test_whether_the_calibration_holds_is_on_the_screen(tracking, line):
    has(shown(snapshot(state(tracking={"calibration": "3fa2c1", **tracking}))), line)


def test_what_has_departed_goes_on_below():
    departed = [{**TRACKED, "name": f"alpha_{p}", "departed": True} for p in "abc"]
    about = {"calibration": "3fa2c1", "quantities": departed, "turns": 70}
    lines = shown(snapshot(state(tracking=about)), width=80, height=40)
    [first] = [n for n, line in enumerate(lines) if line.startswith("tracked")]
    said = " ".join(line[13:].strip() for line in lines[first : first + 3])
    assert all(f"alpha_{p} 1.0213 +- 0.0042" in said for p in "abc")


def test_what_is_not_tracked_takes_no_line():
    assert not any("tracked" in line for line in shown(snapshot(state()), height=40))


def test_a_narrow_screen_has_sparklines_without_halves_of_numbers_and_says_how_to_stop():
    history = MinMaxHistory()
    history.add(ticks(60.0, 2.0))
    lines = shown(snapshot(state(), columns=history.columns), width=40, height=12)
    sparks = [line for line in lines if line.startswith(("torque", "speed", "current"))]
    assert len(sparks) == 5
    assert not any(line.endswith(UNICODE.ellipsis) for line in sparks), sparks
    assert any(line.endswith("now") for line in lines)
    assert lines[-1] == "Esc: stop, q: quit, ?: all keys"
    wide = shown(snapshot(state(), columns=history.columns))
    assert any(line.endswith("max 2.000") for line in wide)
