"""A virtual bench brought into a state, a fault injected into it, and what came of it."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from motord.config import Config, load
from motord.config.faults import Fault
from motord.control.types import SETPOINT
from motord.rig.truth import RigTruth
from motord.rig.truth import load as load_rig
from motord.schema import Flag, Request, State
from motord.virtual.bench import VirtualBench

STATES = ("OFF", "READY", "idle", "torque", "ramping", "TRIPPED")
"""States of the matrix: idle is ENABLED at zero torque, torque 3 Nm at 0.7 turns a second."""

BRAKE = 0.643
TORQUE_NM = 3.0
ZERO_A = 1e-3
AFTER_S = 0.3
RECOVERY_S = 1.5


@cache
def packaged() -> tuple[Config, RigTruth]:
    """Return the packaged bench and its rig, read once: a matrix has hundreds of benches."""
    config = load()
    return config, load_rig(config.bench.rig)


@dataclass(frozen=True)
class Outcome:
    """What a fault did.

    detected_ms: until the state was TRIPPED; in OFF and TRIPPED until a bit was up that was not
    before. None: never. first: the first cause then. zero_ms: from there until no current flowed.
    most_A: the largest true current from the injection on, within ticks too for the rig's faults.
    recovered: enabled again after it.
    lost: ticks that are neither recorded nor counted as missed.
    """

    detected_ms: float | None
    first: int
    bits: int
    zero_ms: float
    most_A: float
    recovered: bool
    lost: int


class Driver:
    """A virtual bench with the requests of an operator."""

    def __init__(self, config: Config | None = None, seed: int = 1) -> None:
        bench, truth = (config, None) if config else packaged()
        self.bench = VirtualBench(bench, truth, seed)
        self.rate_Hz = self.bench.config.loop.rate_Hz
        self.setpoint = np.zeros(1, SETPOINT)
        self.setpoint["plan_point"] = -1
        self.ticks: list[np.ndarray] = []
        self.truth: list[np.ndarray] = []

    def run(self, duration_s: float) -> np.record:
        """Run on; return the last tick."""
        ticks, truth = self.bench.run(self.setpoint, max(round(duration_s * self.rate_Hz), 1))
        self.ticks.append(ticks)
        self.truth.append(truth)
        last: np.record = ticks[-1]
        return last

    def ask(self, request: Request, **fields: Any) -> None:
        """Ask once, with what else is to be set."""
        s = self.setpoint[0]
        s.request = request
        s.request_seq += 1
        self.set(**fields)

    def set(self, **fields: Any) -> None:
        """Set fields of the set-point."""
        for name, value in fields.items():
            self.setpoint[0][name] = value

    def bring_to(self, state: str, trip_by: str = "inverter_fault") -> None:
        """Bring a fresh bench into one of STATES; TRIPPED by a short fault of kind `trip_by`."""
        self.set(brake=BRAKE)
        self.run(1.0)
        if state == "OFF":
            return
        self.ask(Request.ENABLE)
        self.run(0.05)
        if state == "READY":
            self.ask(Request.DISABLE)
            self.run(0.05)
        elif state == "torque":
            self.set(torque_Nm=TORQUE_NM)
            self.run(2.0)
        elif state == "ramping":
            self.set(torque_Nm=TORQUE_NM)
            self.run(0.15)
        elif state == "TRIPPED":
            self.bench.inject(Fault(kind=trip_by, for_s=0.03))
            self.run(0.1)
        wanted = {"READY": State.READY, "TRIPPED": State.TRIPPED}.get(state, State.ENABLED)
        assert self.ticks[-1]["state"][-1] == wanted, (state, self.ticks[-1]["trip_bits"][-1])

    def recover(self) -> bool:
        """Reset if need be, and enable at no torque; True if that holds."""
        self.set(torque_Nm=0.0)
        if self.run(RECOVERY_S).state == State.TRIPPED:
            self.ask(Request.RESET)
            if self.run(0.05).state != State.READY:
                return False
        self.ask(Request.ENABLE)
        return bool(self.run(0.3).state == State.ENABLED)

    def lost(self) -> int:
        """Return how many ticks are neither there nor counted as missed."""
        ticks = np.concatenate(self.ticks)
        gaps = np.diff(ticks["tick"].astype(np.int64)) - 1
        missed = np.diff(ticks["missed"].astype(np.int64))
        flagged = (ticks["flags"][1:] & Flag.AFTER_GAP) != 0
        return int(np.abs(gaps - missed).sum() + (flagged != (gaps > 0)).sum())


def largest_A(truth: np.ndarray) -> np.ndarray:
    """Return the largest true current of each row."""
    largest: np.ndarray = np.max([np.abs(truth[f"i_{phase}_A"]) for phase in "abc"], axis=0)
    return largest


def outcome(fault: Fault, state: str, seed: int = 1) -> Outcome:
    """Inject `fault` into a bench in `state`."""
    driver = Driver(seed=seed)
    driver.bring_to(state, "inverter_fault" if fault.kind != "inverter_fault" else "bus_voltage")
    before = int(driver.ticks[-1]["trip_bits"][-1])
    begun, begun_tick = len(driver.ticks), driver.bench.tick
    driver.bench.inject(fault)
    driver.run(fault.duration_s + AFTER_S)
    ticks, truth = driver.ticks[begun], driver.truth[begun]
    new = (ticks["trip_bits"] & ~np.uint32(before)) != 0
    if state not in ("OFF", "TRIPPED"):
        new &= ticks["state"] == State.TRIPPED
    rows = np.flatnonzero(new)
    recovered = driver.recover()
    most_A = float(largest_A(np.concatenate(driver.truth[begun:])).max())
    most_A = max(most_A, driver.bench.fault_peak_A)
    if not rows.size:
        return Outcome(None, 0, 0, 0.0, most_A, recovered, driver.lost())
    row = int(rows[0])
    flowing = np.flatnonzero(largest_A(truth)[row:] > ZERO_A)
    zero_ms = 0.0
    if flowing.size:
        last = row + int(flowing[-1])
        zero_ms = float(ticks["tick"][min(last + 1, len(ticks) - 1)] - ticks["tick"][row])
    per_ms = 1e-3 * driver.rate_Hz
    first = ticks["trip_bits"][row] & ~np.uint32(before)
    if state not in ("OFF", "TRIPPED"):
        first = ticks["first_trip"][row]
    return Outcome(
        float(int(ticks["tick"][row]) - begun_tick) / per_ms, int(first),
        int(ticks["trip_bits"][-1]), zero_ms / per_ms, most_A, recovered,
        driver.lost(),
    )  # fmt: skip
