"""The limits of the benches in config/ as they stand there, on the wire, in virtual time.

Everything else that runs daemon and emulator in real time does so with wider limits, for computers
that stall (`tests.system.daemons.patient`).
"""

import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from motord.config import Config, load
from motord.schema import State, Trip
from tests.support.virtual_wire import WireLoop, on_the_wire
from tests.unit.emulate.benches import EMULATED, write_bench
from tests.unit.service.virtual_service import VirtualService

MS = 1_000_000
TORQUE_NM = 0.1
"""Less than the cogging torque, which holds the rotor: there is no brake."""
FILES = [EMULATED, EMULATED.with_name("dq.toml")]


def shipped(folder: Path, source: Path) -> Config:
    """Return a bench of config/ on a CAN bus of python-can, without brake and drive."""
    path = write_bench(folder, source=source)
    text = re.sub(r'interface = "udp_multicast"', 'interface = "virtual"', path.read_text())
    text = re.sub(r"^options = .*$", "", text, flags=re.M)
    text = text.replace('driver = "modbus"', 'driver = "none"')
    text = re.sub(r'channel = "[\d.]+"', f'channel = "{folder}"', text)
    path.write_text(text)
    changed, original = load(path), load(source)
    for table in ("loop", "limits"):
        assert getattr(changed, table) == getattr(original, table)
    for table, fields in (("inverter", ("stale_after_s", "timeout_s")),
                          ("bridge", ("stale_after_s", "heartbeat_timeout_s"))):  # fmt: skip
        for name in fields:
            assert getattr(getattr(changed, table), name) == getattr(getattr(original, table), name)
    return changed


class Bench:
    """A bench under torque."""

    def __init__(self, config: Config, service: VirtualService, loop: WireLoop) -> None:
        self.config, self.service, self.loop, self.world = config, service, loop, loop.world
        self.token = service.enabled()
        service.ask("set", token=self.token, torque_Nm=TORQUE_NM)
        service.run_s(0.2, self.token)
        assert service.bench.state is State.ENABLED, service.messages()
        assert largest_A(self.world.truth[-1:]) > 0.1

    def period_ns(self) -> int:
        return 1_000_000_000 // self.config.loop.rate_Hz

    def alone(self, seconds: float) -> None:
        """Let the loop go on without a supervisor."""
        self.loop.run(round(seconds * self.config.loop.rate_Hz))

    def tripped(self) -> Any:
        """Return the first tick of the trip."""
        ticks = self.loop.ticks
        return ticks[ticks["state"] == State.TRIPPED][0]

    def now_of(self, tick: Any) -> int:
        return int(tick["t_ns"]) + int(tick["sample_age_ns"])


@pytest.fixture(params=FILES, ids=lambda path: path.stem)
def bench(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Bench]:
    config = shipped(tmp_path, request.param)
    with on_the_wire(config, tmp_path) as (service, loop):
        yield Bench(config, service, loop)


def largest_A(truth: np.ndarray) -> float:
    return float(np.max([np.abs(truth[f"i_{phase}_A"]) for phase in "abc"]))


def test_nothing_trips_in_normal_operation(bench: Bench) -> None:
    bench.service.run_s(1.5, bench.token)
    ticks = bench.loop.ticks
    assert bench.service.bench.state is State.ENABLED
    assert not ticks["trip_bits"][ticks["state"] == State.ENABLED].any()
    assert (np.diff(ticks["tick"].astype(np.int64)) == 1).all()
    assert (ticks["missed"] == 0).all()


@pytest.mark.parametrize("device", ["inverter", "bridge"])
def test_a_silent_device_trips_at_its_limit(bench: Bench, device: str) -> None:
    last_ns = bench.world.now_ns
    silence(bench, device)
    limit_s = getattr(bench.config, device).stale_after_s
    bench.service.run_s(limit_s + 0.1, bench.token)
    tick = bench.tripped()
    cause = Trip.INVERTER_STALE if device == "inverter" else Trip.ENCODER_STALE
    assert Trip(int(tick["first_trip"])) is cause
    late_ns = bench.now_of(tick) - last_ns - limit_s * 1e9
    assert abs(late_ns) <= 2 * bench.period_ns()
    off = bench.world.truth["t_ns"] > bench.now_of(tick) + 10 * MS
    assert off.any()
    assert largest_A(bench.world.truth[off]) < 1e-3


def silence(bench: Bench, device: str) -> None:
    """Let a device say nothing from now on; it goes on hearing."""
    emulator: Any = bench.world.emulator
    if device == "inverter":
        emulator._can.send = lambda *_: None
    else:
        emulator._link.send = lambda *_: True
        emulator._link.sample = lambda *_: None


def test_without_its_supervisor_the_loop_ramps_down_at_its_limit(bench: Bench) -> None:
    heartbeat_ns = bench.world.now_ns
    limit_s = bench.config.loop.supervisor_timeout_s
    bench.alone(limit_s + 0.1)
    tick = bench.tripped()
    assert Trip(int(tick["first_trip"])) is Trip.SUPERVISOR_STALE
    ticks = bench.loop.ticks
    since_ns = ticks["t_ns"] + ticks["sample_age_ns"] - heartbeat_ns
    full = ticks["torque_set_Nm"] > TORQUE_NM - 1e-6
    assert abs(int(since_ns[full][-1]) - limit_s * 1e9) <= 2 * bench.period_ns()
    ramp_s = TORQUE_NM / bench.config.limits.torque_rate_Nm_per_s
    assert int(since_ns[ticks["torque_set_Nm"] != 0][-1]) <= (limit_s + ramp_s + 0.01) * 1e9


def test_without_the_loop_inverter_and_board_switch_off_at_their_limits(bench: Bench) -> None:
    last_ns = bench.world.now_ns
    bench.world.advance(last_ns + 1_100 * MS)
    truth = bench.world.truth
    since_ns = truth["t_ns"] - last_ns
    line_ns = round(bench.config.bridge.heartbeat_timeout_s * 1e9)
    off_ns = min(line_ns, round(bench.config.inverter.timeout_s * 1e9))
    for field, limit_ns in (("enable_line", line_ns), ("inverter_on", off_ns)):
        last_on_ns = int(since_ns[truth[field] == 1][-1])
        assert limit_ns - 2 * MS <= last_on_ns <= limit_ns + MS
    assert largest_A(truth[since_ns > off_ns + 10 * MS]) < 1e-3


def test_a_loop_held_up_between_waking_and_reading_goes_on(bench: Bench) -> None:
    """What came meanwhile is newer than the tick's begin; that is no sample from the future."""
    rig, read, held = bench.loop.rig, bench.loop.rig.read, [20 * MS]

    def late(now_ns: int, feedback: np.ndarray) -> None:
        bench.world.advance(bench.world.now_ns + (held.pop() if held else 0))
        read(now_ns, feedback)

    rig.read = late
    bench.service.run_s(0.3, bench.token)
    assert bench.service.bench.state is State.ENABLED, bench.service.messages()[-2:]


def test_a_loop_that_was_kept_waiting_too_long_trips(bench: Bench) -> None:
    ticks = bench.config.loop.overrun_ticks
    bench.world.advance(bench.world.now_ns + (ticks + 2) * bench.period_ns())
    with suppress(AssertionError):
        bench.service.run_s(0.1, bench.token)
    assert int(bench.tripped()["trip_bits"]) & Trip.LOOP_OVERRUN
