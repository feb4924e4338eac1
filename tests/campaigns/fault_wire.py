"""Faults on the wire: daemon and emulator in real time, faults by command, one after the other."""

import json
import re
import signal
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from motord.client import ClientError
from motord.config import load
from motord.config.faults import Fault
from motord.emulate.control import inject
from motord.recording.reader import open_run
from motord.schema import FAULT_COUNT_SHIFT, Flag, State, Trip
from tests.campaigns.fault_bench import STATES
from tests.campaigns.fault_table import ENABLED, RUNNING
from tests.support import stalls
from tests.system.daemons import (
    daemon,
    emulator,
    forgive,
    patient,
    runtime_of,
    stalls_from_now,
    wait_for,
)
from tests.unit.emulate.benches import write_bench

RATE_HZ = 500
STALE_S = 1.0
TORQUE_NM = 3.0
BRAKE = 0.58
"""Excitation that holds this torque at about 0.7 turns a second."""
BRAKE_S = 0.8
TORQUE_RATE_NM_PER_S = 10.0
TIMING_MS = 20.0
"""Of emulator (5 ms at once), tick and telemetry, on any computer."""
CLEAR_S = 1.5
"""Within so long of a fault's end, as in virtual time, the bench can be enabled again."""
NO_TRIP = Trip(0)
ACTS_MS = 50.0
"""Within this time of an alarm the supervisor has begun to ramp the torque down."""


@dataclass(frozen=True)
class WireCell:
    """The first causes that are right in a state, and the time within which one must be found.

    Not `certain`: where the rotor stands decides whether there is anything to find; so it does if
    the rotor truly turns less than `turns` from the fault on, as where a wrong angle parks it.
    """

    causes: Trip = NO_TRIP
    within_ms: float = 0.0
    certain: bool = True
    turns: float = 0.0


@dataclass(frozen=True)
class WireRow:
    """A fault, what it leads to in each state, and where it shows if it does not trip.

    With `alarm_ms` an event `device` must report it within that time, whatever the state, and no
    torque be left once it is ramped down.
    """

    fault: Fault
    cells: dict[str, WireCell]
    without: str = ""
    alarm_ms: float = 0.0

    @property
    def name(self) -> str:
        """The fault with its parameters."""
        parameters = ", ".join(f"{key} {value}" for key, value in self.fault.parameters().items())
        return f"{self.fault.kind} {self.fault.duration_s:g} s" + (
            f" ({parameters})" if parameters else ""
        )


@dataclass(frozen=True)
class WireOutcome:
    """What the recording and the rig's truth say of one fault in one state.

    Times in ms after the fault's begin; zero_ms after the detection. late_ms: for how long the
    computer kept the bench's processes from running meanwhile.
    """

    row: WireRow
    state: str
    reported: bool  # by the emulator, and in the recording's bridge_status
    first: Trip
    detected_ms: float | None
    zero_ms: float
    not_recovered: str
    late_ms: float
    alarm_ms: float | None = None
    torque_ms: float = 0.0  # until the torque set-point was zero
    turned: float | None = None  # turns, true, while the fault lasted, where nothing tripped


def _row(
    kind: str,
    causes: Trip = NO_TRIP,
    within_ms: float = 0.0,
    states: tuple[str, ...] = STATES,
    without: str = "",
    others: dict[str, WireCell] | None = None,
    alarm_ms: float = 0.0,
    turns: float = 0.0,
    **parameters: Any,
) -> WireRow:
    cells = dict.fromkeys(STATES, WireCell())
    cells |= dict.fromkeys(states, WireCell(causes, within_ms, turns=turns)) | (others or {})
    fault = Fault.model_validate({"kind": kind, **parameters})
    return WireRow(fault, cells, without, alarm_ms)


_STALE_MS = STALE_S * 1e3 + 5
_OFF_LINE = Trip.INVERTER_FAULT | Trip.ENCODER_STALE
_STANDS = "nothing: without current it reads as it should"
_SLOW = "nothing: the rotor stands within the track's period"
_TILTED = Trip.ENCODER_IMPLAUSIBLE
_ASTRAY = Trip.CURRENT_IMPLAUSIBLE
_STANDING = ("OFF", "READY", "idle", "TRIPPED")
_BY_CHANCE = dict.fromkeys(_STANDING, WireCell(Trip.ENCODER_IMPLAUSIBLE, 2050, certain=False))
_UNHEARD = dict.fromkeys(("OFF", "READY", "TRIPPED"), WireCell(Trip.ENCODER_STALE, _STALE_MS))
_DRIFTED = dict.fromkeys(("OFF", "READY", "TRIPPED"), WireCell(Trip.OVER_TORQUE, 1250))

WIRE_TABLE = (
    _row("inverter_fault", Trip.INVERTER_FAULT, 20),
    _row("inverter_off", Trip.INVERTER_FAULT, 20, ENABLED, "nothing: it is off already"),
    _row("current_stuck", _ASTRAY, 600, RUNNING, _STANDS, for_s=1.0),
    _row("current_noise", Trip.OVER_CURRENT | _ASTRAY, 1000, for_s=1.0),
    _row("current_runaway", Trip.INVERTER_FAULT, 20, ENABLED, "nothing: no voltage is applied"),
    _row("phase_open", _ASTRAY | Trip.TORQUE_IMPLAUSIBLE, 600, RUNNING, _STANDS, for_s=1.0),
    _row("encoder_bit", _TILTED | Trip.OVER_SPEED | Trip.TORQUE_IMPLAUSIBLE, 600, RUNNING, _SLOW,
         others=_BY_CHANCE, turns=2.5 * 1024 / 4096),
    _row("encoder_bit", _TILTED, 600, RUNNING, _SLOW, others=_BY_CHANCE, turns=2.5 * 64 / 4096,
         bit=5, level=1),
    _row("encoder_frozen", _ASTRAY | Trip.TORQUE_IMPLAUSIBLE, 600, RUNNING,
         "nothing: the rotor stands still"),
    _row("encoder_skew", _TILTED, 300, RUNNING, "nothing: the tracks read the same displaced",
         others=_BY_CHANCE, counts=600),
    _row("index_slip", _TILTED, 20, counts=600),
    _row("torque_drift", Trip.TORQUE_IMPLAUSIBLE, 600, ENABLED, others=_DRIFTED),
    _row("torque_saturated", Trip.OVER_TORQUE, 30),
    _row("inverter_hot", Trip.TEMPERATURE, 120, for_s=0.5),
    _row("bus_voltage", Trip.BUS_VOLTAGE, 120, for_s=0.5, others={"TRIPPED": WireCell()},
         without="nothing: this very cause has tripped it before"),
    _row("brake_hot", Trip.BRAKE_TEMPERATURE, 250),
    _row("brake_silent", without="event `device`: stale, torque to zero", alarm_ms=1050),
    _row("host_stall", without="ages of the samples", for_s=0.05),
    _row("can_drop", Trip.INVERTER_STALE, _STALE_MS, for_s=1.3),
    _row("can_drop", without="`link_errors`", fraction=0.05),
    _row("can_corrupt", Trip.INVERTER_STALE | Trip.LINK_ERRORS, _STALE_MS, for_s=1.3),
    _row("can_duplicate", without="`link_errors`", fraction=0.3),
    _row("can_late", without="`i_age_ns`", delay_s=0.02),
    _row("can_bus_off", Trip.BUS_OFF, 10),
    _row("bridge_drop", _OFF_LINE, _STALE_MS, for_s=1.3),
    _row("bridge_drop", without="`link_errors`", fraction=0.05),
    _row("bridge_corrupt", _OFF_LINE, _STALE_MS, for_s=1.3),
    _row("bridge_duplicate", without="`link_errors`", fraction=0.3),
    _row("bridge_late", without="`sample_age_ns`", delay_s=0.02),
    _row("bridge_reboot", Trip.INVERTER_FAULT, 20, ENABLED, for_s=1.3, others=_UNHEARD),
    _row("bridge_reboot", Trip.INVERTER_FAULT, 20, ENABLED, for_s=0.05,
         without="`sample_age_ns`; the line is open already"),
    _row("bridge_clock", without="the clock filter's resets", jump_s=0.3),
)  # fmt: skip
"""Faults on the wire; times beyond those in virtual time are those of the emulated bench's file."""

FEW = ("can_bus_off", "bridge_reboot", "inverter_off", "encoder_bit", "current_noise",
       "brake_silent", "bridge_clock")  # fmt: skip


def bench_file(folder: Path) -> Path:
    """Write the bench of a session."""
    path = write_bench(folder)
    text = patient(path.read_text(), "faults", RATE_HZ)
    text = text.replace("encoder_jump_rad = 1.5", "encoder_jump_rad = 0.5")
    text = re.sub(r"^(torque|current)_error_s = .*\n", "", text, flags=re.M)
    most_per_s = float(2 * RATE_HZ)  # frames of feedback and samples that the loop needs
    text = re.sub(r"^(link_errors_per_s) = .*$", rf"\1 = {most_per_s}", text, flags=re.M)
    path.write_text(f'{text}\n[recording]\nauto = "always"\n')  # faults come while OFF, too
    return path


def session(folder: Path, rows: tuple[WireRow, ...], states: tuple[str, ...]) -> list[WireOutcome]:
    """Inject every fault in every state; return what came of it. Fails if ticks were lost."""
    bench, truth = bench_file(folder), folder / "truth.mcap"
    config = load(bench)
    troubles, late_ms = [], []
    with (
        runtime_of(folder),
        emulator(folder, bench, truth) as devices,
        daemon(folder, bench) as running,
    ):
        with running.connect() as client, client.lease("faults") as lease:
            for row in rows:
                for state in states:
                    _bring_to(client, lease.token, state, config)
                    kept = stalls_from_now(client)
                    inject(config, row.fault.model_dump(exclude_none=True))
                    _let_pass(client, row.fault.duration_s + AFTER_S)
                    late_ms.append(1e3 * kept.delay_s(client.state().loop.missed))
                    troubles.append(_recover(client, lease.token))
            client.rpc("stop")
        assert running.end() == 0, running.said()
        devices.process.send_signal(signal.SIGTERM)
        said = devices.process.stdout.read().decode().splitlines()
        assert devices.wait() == 0, devices.said()
        runs = running.runs()
        ticks = np.concatenate([run.ticks() for run in runs])
        said_ns = [
            int(event["t_ns"])
            for run in runs
            for event in run.events()
            if event["kind"] == "device" and event["data"].get("health") == "stale"
        ]
    events = [event for event in map(json.loads, said) if "kind" in event]
    events = [event for event in events if event["for_s"] != SETUP_S]
    _check_ticks(ticks)
    plan = [(row, state) for row in rows for state in states]
    assert len(events) == len(plan) == len(troubles)
    rig = open_run(truth).truth()
    return [
        _outcome(row, state, event, ticks, rig, trouble, late, said_ns)
        for (row, state), event, trouble, late in zip(plan, events, troubles, late_ms, strict=True)
    ]


AFTER_S = 0.4
BEYOND_S = 0.3
SETUP_S = 0.3125
"""How long the fault lasts that brings a bench to TRIPPED: by this it is known."""


def _bring_to(client: Any, token: str, state: str, config: Any) -> None:
    """Bring the bench, which is OFF, into a state of STATES."""
    if state == "OFF":
        client.rpc("stop")
        return
    if state in ("torque", "ramping"):
        _turn(client, token, state)
        return
    _enable(client, token)
    if state == "READY":
        client.rpc("disable", token=token)
    elif state == "TRIPPED":
        _trip(client, config)


def _let_pass(client: Any, duration_s: float) -> None:
    """Wait until the loop's ticks are that much later."""
    end_ns = client.state().tick.t_ns + round(duration_s * 1e9)
    wait_for(client, lambda state: state.tick.t_ns >= end_ns, f"{duration_s} s of ticks")


def _turn(client: Any, token: str, state: str) -> None:
    """Bring the bench under torque; one that a busy computer trips meanwhile is tried again."""
    while True:
        kept = _enable(client, token)
        try:
            client.rpc("set", token=token, brake=BRAKE)
            _let_pass(client, BRAKE_S)
            client.rpc("set", token=token, torque_Nm=TORQUE_NM)
        except ClientError as error:
            forgive(client, kept, error)
            continue
        if state == "ramping" or wait_for(client, _there_or_not, "the torque").state == "ENABLED":
            return
        forgive(client, kept)


def _there_or_not(state: Any) -> bool:
    return state.state != "ENABLED" or bool(state.tick.torque_set_Nm > TORQUE_NM - 0.01)


def _trip(client: Any, config: Any) -> None:
    """Trip the bench by a fault that lasts longer than it takes to be found."""
    inject(config, {"kind": "bus_voltage", "for_s": SETUP_S})
    wait_for(client, lambda state: state.state == "TRIPPED", "the trip")
    _let_pass(client, SETUP_S + 0.5)


def _enable(client: Any, token: str) -> stalls.Stalls:
    """Enable, again only after a trip that a busy computer explains; return stalls since then."""
    while True:
        kept = stalls_from_now(client)
        try:
            client.rpc("reset", token=token)
            assert client.rpc("enable", token=token) == {"state": "ENABLED"}
            return kept
        except ClientError as error:
            forgive(client, kept, error)


def _recover(client: Any, token: str) -> str:
    """Reset, enable at no torque, stop; return what did not work, if anything."""
    with suppress(ClientError):  # where it is not enabled
        client.rpc("set", token=token, torque_Nm=0.0)
    _let_pass(client, CLEAR_S - AFTER_S)
    try:
        _enable(client, token)
    except AssertionError as error:
        return str(error)
    finally:
        client.rpc("stop")
    return ""


def _check_ticks(ticks: np.ndarray) -> None:
    """Every tick is there once, or counted as missed."""
    steps = np.diff(ticks["tick"].astype(np.int64))
    assert (steps >= 1).all()
    assert np.array_equal(steps - 1, np.diff(ticks["missed"].astype(np.int64)))
    assert np.array_equal(ticks["flags"][1:] & Flag.AFTER_GAP > 0, steps > 1)


def _outcome(
    row: WireRow, state: str, event: dict[str, Any], ticks: np.ndarray, truth: np.ndarray,
    not_recovered: str, late_ms: float, said_ns: list[int],
) -> WireOutcome:  # fmt: skip
    """Read off the recording what a fault did, from its event until BEYOND_S after its end."""
    period_ns = round(1e9 / RATE_HZ)
    now_ns = ticks["t_ns"] + ticks["sample_age_ns"]
    begun_ns = int(event["t_ns"])
    over_ns = begun_ns + round(row.fault.duration_s * 1e9)
    end_ns = over_ns + round(BEYOND_S * 1e9)
    during = np.flatnonzero((now_ns >= begun_ns - period_ns) & (now_ns <= end_ns))
    here = ticks[during]
    reported = bool(((here["bridge_status"] >> FAULT_COUNT_SHIFT) == event["fault"] % 128).any())
    before = int(ticks["trip_bits"][max(int(during[0]) - 1, 0)])
    new = (here["trip_bits"] & ~np.uint32(before)) != 0
    if state not in ("OFF", "TRIPPED"):
        new &= here["state"] == State.TRIPPED
    rows = np.flatnonzero(new)
    if not rows.size:
        alarms = [t_ns for t_ns in said_ns if begun_ns <= t_ns <= end_ns]
        alarm_ms = (alarms[0] - begun_ns) * 1e-6 if alarms else None
        under = np.flatnonzero(here["torque_set_Nm"])
        torque_ms = (int(now_ns[during[under[-1]]]) - begun_ns) * 1e-6 if under.size else 0.0
        angles_rad = truth["angle_rad"][(truth["t_ns"] >= begun_ns) & (truth["t_ns"] <= over_ns)]
        turned = float(np.ptp(angles_rad)) / (2 * np.pi) if angles_rad.size else None
        return WireOutcome(
            row, state, reported, Trip(0), None, 0.0, not_recovered, late_ms, alarm_ms, torque_ms,
            turned,
        )  # fmt: skip
    tick = here[int(rows[0])]
    first = int(tick["trip_bits"]) & ~before
    first = int(tick["first_trip"]) if state not in ("OFF", "TRIPPED") else first & -first
    at_ns = int(now_ns[during[rows[0]]])
    then = truth[(truth["t_ns"] >= at_ns) & (truth["t_ns"] <= end_ns)]
    largest = np.max([np.abs(then[f"i_{phase}_A"]) for phase in "abc"], axis=0)
    flowing = np.flatnonzero(largest > 1e-3)
    zero_ms = (int(then["t_ns"][flowing[-1]]) - at_ns) * 1e-6 if flowing.size else 0.0
    detected_ms = (at_ns - begun_ns) * 1e-6
    return WireOutcome(
        row, state, reported, Trip(first), detected_ms, zero_ms, not_recovered, late_ms
    )


def wrong(one: WireOutcome) -> list[str]:
    """Return what is not as it must be; to the times is added what the computer took away."""
    cell, faults, late_ms = one.row.cells[one.state], [], one.late_ms + TIMING_MS
    if not one.reported:
        faults.append("not reported in the recording")
    certain = cell.certain
    if cell.turns and one.detected_ms is None:
        if one.turned is None:
            faults.append("nothing in the recording on how far the rotor turned")
        else:
            certain = one.turned >= cell.turns
    if cell.causes and certain and one.detected_ms is None:
        faults.append("not detected")
    elif one.detected_ms is not None and not cell.causes & one.first:
        faults.append(f"tripped: {one.first.name}")
    elif one.detected_ms is not None and one.detected_ms > cell.within_ms + late_ms:
        faults.append(f"detected after {one.detected_ms:.0f} ms, not {cell.within_ms:g} ms")
    if one.row.alarm_ms and one.detected_ms is None:
        faults += _wrong_alarm(one, late_ms)
    if one.zero_ms > 20.0 + late_ms:
        faults.append(f"current for {one.zero_ms:.0f} ms after that")
    if one.not_recovered:
        faults.append(f"not enabled again: {one.not_recovered}")
    return faults


def _wrong_alarm(one: WireOutcome, late_ms: float) -> list[str]:
    if one.alarm_ms is None:
        return ["no alarm"]
    if one.alarm_ms > one.row.alarm_ms + late_ms:
        return [f"alarm after {one.alarm_ms:.0f} ms, not {one.row.alarm_ms:g} ms"]
    ramp_ms = 1e3 * TORQUE_NM / TORQUE_RATE_NM_PER_S
    if one.torque_ms > one.alarm_ms + ACTS_MS + ramp_ms + late_ms:
        return [f"torque for {one.torque_ms - one.alarm_ms:.0f} ms after the alarm"]
    return []
