"""Faults: `python -m tests.campaigns.faults [--write] [--random N] [--seed S] [--wire]`.

Without options the matrix of `fault_table` is run in virtual time. `--write` puts it into
docs/faults.md, `--random N` runs N random timelines, `--wire` the matrix of `fault_wire` with
daemon and emulator in real time (some minutes). Exits with 1 if anything is not as it must be.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from motord.config.faults import KINDS, Timeline
from motord.config.timing import POSITION_AGE_MAX_S
from motord.schema import Request, State, Trip
from tests.campaigns import fault_wire, seeds
from tests.campaigns.fault_bench import (
    BRAKE,
    STATES,
    TORQUE_NM,
    ZERO_A,
    Driver,
    Outcome,
    largest_A,
    outcome,
)
from tests.campaigns.fault_table import TABLE, Cell, Row
from tests.support.random_faults import random_timeline

DOCUMENT = Path(__file__).parents[2] / "docs" / "faults.md"
MARK = "<!-- measured: below this line by python -m tests.campaigns.faults --write -->"
WIRE_MARK = "<!-- measured on the wire: by python -m tests.campaigns.faults --wire --write -->"
ZERO_MS = 20.0
DRIVE_LIMIT_A = 60.0
"""The simulated drive's own limit, at which it switches itself off ([inverter] current_max_A)."""

SPAN_S = 4.0


def wrong(row: Row, state: str, found: Outcome) -> list[str]:
    """Return what is not as the table says; nothing if all is well."""
    cell, faults = row.cells[state], []
    first = found.first & -found.first
    if cell.cause is None and found.detected_ms is not None:
        faults.append(f"tripped: {Trip(first).name}")
    elif cell.cause is not None and found.detected_ms is None:
        faults.append("not detected")
    elif cell.cause is not None and found.detected_ms is not None:
        if first != cell.cause:
            faults.append(f"first cause {Trip(first).name}")
        if found.detected_ms > cell.within_ms:
            faults.append(f"detected after {found.detected_ms:g} ms, not {cell.within_ms:g} ms")
    if found.zero_ms > ZERO_MS:
        faults.append(f"current for {found.zero_ms:g} ms after that")
    if found.most_A > limit_A(row.fault.kind):
        faults.append(f"{found.most_A:.1f} A")
    if not found.recovered:
        faults.append("not enabled again")
    if found.lost:
        faults.append(f"{found.lost} ticks lost")
    return faults


def limit_A(*kinds: str) -> float:
    """Return the current that must never be exceeded with faults of these kinds."""
    trip_A = Driver().bench.config.limits.trip_current_A
    return DRIVE_LIMIT_A if "current_runaway" in kinds else trip_A


def random_run(seed: int) -> tuple[Timeline, list[str], State, Trip]:
    """Run a random timeline under an operator who always tries again.

    Returns the timeline, what was not as it must be, and how it ended.
    """
    timeline = random_timeline(seed, SPAN_S, "virtual")
    driver = Driver(seed=seed)
    for fault in timeline.fault:
        driver.bench.inject(fault)
    driver.set(brake=BRAKE)
    driver.run(0.8)
    driver.ask(Request.ENABLE, torque_Nm=TORQUE_NM)
    while driver.bench.t_s < SPAN_S + 1.0:
        if driver.run(0.25).state == State.TRIPPED:
            driver.ask(Request.RESET)
        elif driver.ticks[-1]["state"][-1] in (State.OFF, State.READY):
            driver.ask(Request.ENABLE)
    driver.ask(Request.STOP)
    last = driver.run(0.3)
    faults = _broken(driver, timeline)
    state, first = State(int(last.state)), Trip(int(last.first_trip))
    if state is not State.OFF and not (state is State.TRIPPED and first):
        faults.append(f"ended in {state.name}")
    return timeline, faults, state, first


def _broken(driver: Driver, timeline: Timeline) -> list[str]:
    """Return which promises a run did not keep."""
    faults = []
    ticks, truth = np.concatenate(driver.ticks), np.concatenate(driver.truth)
    largest = largest_A(truth)
    most_A = max(float(largest.max()), driver.bench.fault_peak_A)
    if most_A > limit_A(*(fault.kind for fault in timeline.fault)):
        faults.append(f"{most_A:.1f} A")
    numbers, allowed = ticks["tick"].astype(np.int64), _allowed_ticks(driver, timeline)
    on = (ticks["state"] == State.ENABLED) | (ticks["state"] == State.READY)  # or arming
    turned_off = np.append(False, on[:-1] & ~on[1:])
    off_for = np.where(on, 0, numbers - np.maximum.accumulate(np.where(turned_off, numbers, 0)))
    late = (off_for > allowed) & (largest > ZERO_A)
    if late.any():
        faults.append(f"current {int(off_for[late].max())} ticks after the trip")
    if driver.lost():
        faults.append(f"{driver.lost()} ticks lost")
    if len(driver.bench.fault_events) != len(timeline.fault):
        faults.append(f"{len(driver.bench.fault_events)} faults reported")
    return faults


def _allowed_ticks(driver: Driver, timeline: Timeline) -> int:
    """Return how long current may flow after a trip: the devices' own timeouts if both links go.

    Then neither the command nor the open enable line reaches the inverter.
    """
    kinds = {fault.kind.split("_")[0] for fault in timeline.fault}
    config = driver.bench.config
    both = {"can", "bridge"} <= kinds
    timeout_s = min(config.inverter.timeout_s, config.bridge.heartbeat_timeout_s)
    return round(((timeout_s if both else 0.0) + ZERO_MS * 1e-3) * driver.rate_Hz)


def matrix() -> tuple[list[list[Outcome]], int]:
    """Run the matrix; print and count what is wrong."""
    found = [[outcome(row.fault, state) for state in STATES] for row in TABLE]
    bad = 0
    for row, outcomes in zip(TABLE, found, strict=True):
        for state, one in zip(STATES, outcomes, strict=True):
            for what in wrong(row, state, one):
                print(f"{row.name}, {state}: {what}")
                bad += 1
    return found, bad


def _cell(cell: Cell) -> str:
    return f"{cell.cause.name} {cell.within_ms:g} ms" if cell.cause is not None else "-"


def static_part() -> str:
    """Return the part of docs/faults.md that follows from the tables alone."""
    lines = [_HEAD, "## Kinds", "", "| kind | what it does | lasts | parameters | where |"]
    lines.append("|---|---|---|---|---|")
    for name, kind in KINDS.items():
        parameters = ", ".join(f"{key} = {value!r}" for key, value in kind.parameters.items())
        where = ", ".join(sorted(kind.places))
        lines.append(f"| `{name}` | {kind.meaning} | {kind.for_s:g} s | {parameters} | {where} |")
    lines += ["", _INTERLOCKS]
    lines += ["", _MATRIX, f"| fault | {' | '.join(STATES)} | if it does not trip, it shows in |"]
    lines.append("|---" * (len(STATES) + 2) + "|")
    for row in TABLE:
        cells = " | ".join(_cell(row.cells[state]) for state in STATES)
        lines.append(f"| {row.name} | {cells} | {row.without} |")
    lines += [
        "",
        _WIRE,
        f"| fault | {' | '.join(STATES)} | if it does not trip, it shows in |",
        "|---" * (len(STATES) + 2) + "|",
    ]
    for wire in fault_wire.WIRE_TABLE:
        cells = " | ".join(_wire_expected(wire, state) for state in STATES)
        lines.append(f"| {wire.name} | {cells} | {wire.without} |")
    return "\n".join([*lines, ""])


def _wire_expected(row: fault_wire.WireRow, state: str) -> str:
    cell = row.cells[state]
    causes = " or ".join(str(trip.name) for trip in Trip if trip & cell.causes)
    if row.alarm_ms and not causes:
        return f"alarm {row.alarm_ms:g} ms"
    text = f"{causes} {cell.within_ms:g} ms" if causes else "-"
    return text if cell.certain else f"({text})"


_WIRE = f"""## On the wire

Daemon and `motord emulate` in real time, the emulated bench's time limits of 1 s (for computers
that stall), 500 Hz, {fault_wire.TORQUE_NM:g} Nm. Times do not count what the computer adds. An
alarm is an event of the supervisor, which ramps the torque down at once; in every other cell the
bounds are those above. In brackets: where the rotor stands decides whether there is anything to
see.
"""

_HEAD = """# Faults: how they are injected, and what they lead to

A timeline is a TOML file; times count from the start of the rig:

```toml
[[fault]]
kind = "can_drop"
at_s = 2.0
for_s = 0.5      # left out: as long as the kind usually lasts
fraction = 0.3   # left out: the kind's default
```

- `[bench] faults = "timeline.toml"`: for a bench simulated in the loop (`sim`), one in virtual time
  (`virtual`), or an emulated one.
- `motord emulate -c FILE --faults timeline.toml`: the emulator's, instead of the bench file's.
- `motord fault inject -c FILE KIND --for-s 0.3 fraction=0.5`: into a running emulator, now. It
  listens on a socket in a folder that only its own user can open.

`config/faults/` has examples. Each injected fault is in the log: the emulator prints a line for it
(`--json`: an object with `t_ns`, `kind` and the parameters), a virtual bench returns it in
`fault_events`, and `bridge_status` counts them from bit 8 on (modulo 128), so every recording has
the tick at which each began, and the daemon makes an event `fault_injected` of it.
A supervisor, recorder or loop that is killed or stopped is a matter of signals, not of a timeline.
"""

_INTERLOCKS = """## Interlocks

[All of them](reference/interlocks.md), with their limits and what to do, are in the reference.
They are evaluated in every tick, in compiled code; a cause takes current and enable away in the
same tick and stays until a reset. A condition that may last a while (debounce) trips with the
first evidence that it has held for so long, so at every rate within this time and two intervals of
its evidence; evidence that does not come has interlocks of its own. One that is interrupted starts
over; `CURRENT_IMPLAUSIBLE` is counted up and down, and after a reset from zero if the newest
currents are right. Speed is known up to @LAG ms
late under a constant acceleration (2 over `loop.observer_bandwidth_Hz` in rad/s, at the lowest
that is allowed); above its limit it bars enabling and reset for 0.1 s more, as an estimate from
few counts falls below it now and then. A torque that swings is above its limit in either direction
for less than half a period: a pure oscillation of 100 Hz or more is no `OVER_TORQUE`, however
large, and where it reaches the end of the sensor's range no `TORQUE_STALE`. A resonance there is
for the choice of sensor and mount; with less than 5 ms single disturbed samples would trip. Where
the newest position is older than @AGE ms no torque is commanded (flag
`POSITION_AGED`). Bench files whose limits, ages, rates and timeouts would not leave every
interlock its time are refused. Currents are compared with the commands that can have been in force
when they were measured (`i_age_ns`), and between these while a current settles: a drive that makes
no current any more is found `inverter.feedback_age_s` later than the times above, and by
`actuation_delay_s` and 3 `lag_s` where its command is new; right currents do not trip at any age up
to `inverter.stale_after_s`. The time that a current is more than `current_error_A` off counts up,
the time that it is not down, and `current_error_s` trips: an error that stays in this time, one
that swings with the current and is beyond the limit for a part f of the time, more than half, in
`current_error_s` / (2 f - 1) and an electrical turn. For a sine of amplitude A times the limit f is
1 - 2/pi asin(1 / A): more than half for A above 1.41, 2/3 for 2. Of n readings in half an
electrical turn one may be off, so f is less by 1 / n: at 333 Hz, 18 rad/s and 8 pole pairs n is 7.
A is that of the currents for an open phase, 1.73 of it for two that are exchanged, half of it for a
gain of 0.5 (in a star a third). An error that is beyond the limit for less is found only where it
is for `current_error_s` at a time, as at low speed. A wrong current that happens to fit one of
several such commands, as it may while the rotor turns, is in doubt, and counts down by a quarter.
An error of one phase by more than 3 times `current_error_A` and what the currents' sum changes by
is never hidden so; a smaller one, or one in a star, is, in a part of the turn: a quarter at 1.8
times (in a star 2.4; there 0.28 with a 5th order of the back-EMF of 3 %), an eighth in a star at
4.5 times, if a current settles within a tick; if it takes many, up to 0.53 (in a star 0.63), and
0.42. So it is found later, at 0.63 after 4.7 times `current_error_s` and an electrical turn. A
right current may be as ambiguous, so disturbed readings trip where one in five
is, if only for a while: at 18 rad/s, with 8 pole pairs and 19 A, of readings that are wrong by 25 A
at random one in a hundred does not trip at 100 Hz, but three do within minutes; at 333 Hz five do
not. A drive whose `lag_s` is 0.45 rad, electrical, may trip where large torques are reversed every
1.5 to 7 `lag_s`, one whose `lag_s` is a radian (or 15 ms and 0.7) after any large step: its
currents are beyond the limit for a moment. The
measured torque is compared with the set-point as the sensor's high-pass shows it, besides a fifth
of the set-point and the torque that limited currents, or a position too old to commutate by, have
lacked lately (the most of it, forgotten within about a second); this only where torque is applied.
While the loop stalls, the currents stand still and the rotor turns on: the torque that they may
have lacked, up to twice the set-point, is allowed for as long as the high-pass remembers it.
A bench file is refused whose `limits.torque_error_s` a step of the set-point would outlast until
it shows, with one sample lost, or a ramp at `torque_rate_Nm_per_s` in which the torque falls behind
by more than is allowed: by delay of the drive, a tick and a sample.
Samples that jump count until the speed explains two in a row: of misread samples that come by
chance, as of one in a hundred, more than of three in a row. A rotor that makes nearly whole turns
from one sample to the next looks like a slow one, and no rule can tell them apart. Where the bridge
samples more often than the loop reads it, two samples that are read one after the other may be as
close together as the bridge takes them. An observer that is as quick makes a speed of the count by
which they differ, so `trip_speed_rad_s` and `encoder_jump_rad` have to be larger, or
`observer_bandwidth_Hz` lower: a bench file is refused in which a sound encoder could seem to jump,
or a rotor at a set-point to be beyond its limit.
An encoder track is stuck if three of its patterns have ended, by what the coarser ones say, and it
has not changed, in three samples: at a steady speed, by which the rotor turns by less than half a
pattern between samples, within 3 patterns and 4 samples, or twice as late where zero is passed and
`counts` are no power of two. Tracks too fine for the speed, or for a rotor that begins to turn by
100 rad/s^2 between two samples, are left out, and the count starts anew when the bench is enabled
or a trip is reset, and where samples are missing in which the track may have changed twice. After a
gap of t between samples these are, of a slow rotor, the tracks whose pattern is shorter than 300 to
900 rad/s^2 times t^2, the more of its patterns have ended (at most 3.6 mrad for 2 ms, 0.09 rad for
10 ms): where such gaps come more often than three patterns of a track end, it may be stuck and stay
unseen. Of tracks about as fine as what the rotor turns between samples one that is stuck may stay
unseen, too, and with it an angle that is wrong by up to 3.5 times that turn (`python -m
tests.campaigns.stuck_tracks`): `motord check` says so where currents could be 0.64 rad (electrical)
off, a fifth of the torque. The two coarsest tracks are not watched in effect: with one of them
stuck the rotor seems to turn back and forth, without a jump, which is an implausible encoder only
if it turns back too quickly for `encoder_jump_rad`. `motord check` also says where the sensor's
high-pass shows a reversal as more than `trip_torque_Nm`, and where encoder or loop are too coarse
for the pole pairs to make the torque that is set.
""".replace("@LAG", f"{1e3 * 2 / (2 * np.pi * 15):.0f}").replace(
    "@AGE", f"{1e3 * POSITION_AGE_MAX_S:g}"
)

_MATRIX = f"""## What each leads to

First cause, and the time within which it must be found; in OFF, where nothing is latched, the cause
that stands against enabling; in TRIPPED the cause that joins the first, which stays. `idle` is
ENABLED at zero torque, `torque` {TORQUE_NM:g} Nm at 0.7 turns a second, `ramping` on the way there.
In every cell besides: no current {ZERO_MS:g} ms after the detection, never more than
`limits.trip_current_A` in a phase ({DRIVE_LIMIT_A:g} A with `current_runaway`: the drive's own
limit), no tick lost, and after a reset the bench can be enabled again. The bench is the packaged
one.

A board that starts anew (`bridge_reboot`: a brown-out, its watchdog) opens the enable line and
keeps it open until a heartbeat has asked for that; those of the run, which still ask for a closed
one, do not close it. So the power stage goes off at once, which is the first cause,
`INVERTER_FAULT`, if the drive reports it; samples that are missing come after that. In OFF, READY
and TRIPPED the line is open already, and only a reboot that lasts longer than
`bridge.stale_after_s` is a cause.
"""


def measured_part(found: list[list[Outcome]]) -> str:
    """Return the measured part of docs/faults.md."""
    lines = [MARK, "", "## Measured, in virtual time", ""]
    lines.append("Detection / from there until no current flows, in ms; and the largest current.")
    lines += ["", f"| fault | {' | '.join(STATES)} | A |", "|---" * (len(STATES) + 2) + "|"]
    for row, outcomes in zip(TABLE, found, strict=True):
        cells = " | ".join(
            "-" if one.detected_ms is None else f"{one.detected_ms:g} / {one.zero_ms:g}"
            for one in outcomes
        )
        most_A = max(one.most_A for one in outcomes)
        lines.append(f"| {row.name} | {cells} | {most_A:.0f} |")
    return "\n".join([*lines, ""])


def wire_part(outcomes: list[fault_wire.WireOutcome]) -> str:
    """Return what was measured on the wire."""
    lines = [WIRE_MARK, "", "## Measured on the wire", ""]
    lines.append("First cause, detection / from there until no current flows, in ms.")
    lines += ["", f"| fault | {' | '.join(STATES)} |", "|---" * (len(STATES) + 1) + "|"]
    for wire in fault_wire.WIRE_TABLE:
        cells = [_wire_cell(one) for one in outcomes if one.row is wire]
        lines.append(f"| {wire.name} | {' | '.join(cells)} |")
    return "\n".join([*lines, ""])


def _wire_cell(one: fault_wire.WireOutcome) -> str:
    if one.detected_ms is None:
        return f"alarm {one.alarm_ms:.0f}" if one.row.alarm_ms and one.alarm_ms else "-"
    return f"{one.first.name} {one.detected_ms:.0f} / {one.zero_ms:.0f}"


def write(measured: str = "", wire: str = "") -> None:
    """Write docs/faults.md; what was not measured now stays as it was."""
    before = DOCUMENT.read_text() if DOCUMENT.exists() else ""
    _, _, old = before.partition(MARK)
    old_measured, _, old_wire = old.partition(WIRE_MARK)
    measured = measured or MARK + old_measured
    wire = wire or (WIRE_MARK + old_wire if old_wire else "")
    parts = [static_part(), measured, wire]
    DOCUMENT.write_text("\n".join(part.strip() + "\n" for part in parts if part))


def run_random(count: int, seed: int) -> int:
    """Run `count` random timelines; print what is wrong and a summary. Returns how many failed."""
    ends: dict[str, int] = {}
    failed, begun_s = 0, time.monotonic()
    for number in range(seed, seed + count):
        timeline, faults, state, first = random_run(number)
        end = state.name if state is State.OFF else f"TRIPPED, {first.name}"
        ends[end] = ends.get(end, 0) + 1
        if faults:
            failed += 1
            print(f"seed {number}: {'; '.join(faults)}")
            for fault in timeline.fault:
                print(f"    at {fault.at_s:g} s {fault.summary()}")
    took_s = time.monotonic() - begun_s
    print(f"{count} random timelines in {took_s:.0f} s, {failed} not as they must be")
    for end, number in sorted(ends.items(), key=lambda item: -item[1]):
        print(f"  {number:4d} ended {end}")
    return failed


def run_wire(kinds: list[str], save: bool) -> int:
    """Run the matrix on the wire; print it. Returns how many cells are not as they must be."""
    rows = tuple(row for row in fault_wire.WIRE_TABLE if not kinds or row.fault.kind in kinds)
    with tempfile.TemporaryDirectory(prefix="motord-faults-") as folder:
        outcomes = fault_wire.session(Path(folder), rows, STATES)
    bad = 0
    for one in outcomes:
        found = "-"
        if one.detected_ms is not None:
            found = f"{one.first.name} {one.detected_ms:.0f} / {one.zero_ms:.0f} ms"
        elif one.alarm_ms is not None:
            found = f"alarm {one.alarm_ms:.0f} ms, no torque after {one.torque_ms:.0f} ms"
        elif one.turned is not None and one.turned < one.row.cells[one.state].turns:
            found = f"- (the rotor turned {one.turned:.2g} turns only)"
        faults = fault_wire.wrong(one)
        bad += bool(faults)
        print(f"{one.row.name:60} {one.state:8} {found:40} {'; '.join(faults)}")
    print(f"{len(outcomes)} cells on the wire, {bad} not as they must be")
    if save and not bad and not kinds:
        write(wire=wire_part(outcomes))
    return bad


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write docs/faults.md")
    parser.add_argument("--random", type=int, default=0, metavar="N", help="random timelines")
    parser.add_argument(
        "--seed", type=int, default=seeds.first(), help="of the first random timeline"
    )
    parser.add_argument("--wire", action="store_true", help="on the wire, in real time")
    kinds = sorted({row.fault.kind for row in fault_wire.WIRE_TABLE})
    parser.add_argument("--only", nargs="+", default=[], choices=kinds, help="on the wire")
    options = parser.parse_args()
    if options.wire:
        return 1 if run_wire(options.only, options.write) else 0
    if options.random:
        return 1 if run_random(options.random, options.seed) else 0
    found, bad = matrix()
    print(f"{len(TABLE)} faults in {len(STATES)} states, {bad} not as they must be")
    if options.write and not bad:
        write(measured_part(found))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
