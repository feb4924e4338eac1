"""Tracking of a calibration in ordinary operation: `python -m tests.campaigns.tracking [PART ...]`.

Rigs of their own run by a calibration that is off their truth by what it states, a few torques in
turn. `drift`: the gain of one phase drifts by 1 % in an hour; prints by how much what is tracked is
off, and when the finding came. `quiet`: ten hours of nothing but noise, temperature and the drift
of the torque sensor; prints the findings. `cost`: share of a core at a loop of 5 kHz. Exits with 1
if a bound is not kept.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from time import process_time

import numpy as np

from motord.calibration import Calibration
from motord.config import Config, load
from motord.control.types import SETPOINT
from motord.experiments.tracking.tracked import TrackedCalibration
from motord.experiments.tracking.tracker import FORGOTTEN, CalibrationTracker
from motord.rig.truth import RigTruth
from motord.schema import Compensate, Request
from motord.sequencing.brake_servo import excitation_for
from motord.service.tracker.process import REPORT_NS
from motord.virtual import VirtualBench, processors
from tests.campaigns import seeds
from tests.campaigns.check_calibration import stated_calibration, with_drift
from tests.campaigns.estimator import rig

DRIFT_RIGS = 6
QUIET_RIGS = 2
QUIET_H = 10
DRIFT_PER_H = 0.01
FOLLOWED = 0.002
COVERAGE = 0.9
SHARE = 0.05
MEMORY_S = 300.0
LOOK_S = 60
BLOCK_S = 1
COST_S = 120

TORQUES_Nm = (2.0, 5.0, 3.5, 4.5, 1.0)
DWELL_S = 30
SPEED_Hz = 0.8

WARM_UP_S = 1200
"""Operation before the drift begins."""


class Operation:
    """A virtual bench in ordinary operation: torques in turn, with compensation."""

    def __init__(self, bench: VirtualBench, torques_Nm: Sequence[float] = TORQUES_Nm) -> None:
        self.bench, self._torques_Nm = bench, torques_Nm
        self._setpoint = np.zeros(1, SETPOINT)
        self._setpoint["plan_point"] = -1
        self._setpoint["compensate"] = Compensate.CURRENTS | Compensate.COGGING
        self._setpoint["speed_rad_s"] = 2 * np.pi * SPEED_Hz
        bench.run(self._setpoint, bench.config.loop.rate_Hz // 2)
        self._setpoint["request"], self._setpoint["request_seq"] = Request.ENABLE, 1

    def blocks(self, seconds: int) -> Iterator[np.ndarray]:
        """Yield the ticks of each second."""
        bench = self.bench
        for _ in range(0, seconds, BLOCK_S):
            place = int(bench.t_s // DWELL_S) % len(self._torques_Nm)
            torque_Nm = self._torques_Nm[place]
            self._setpoint["torque_Nm"] = torque_Nm
            self._setpoint["brake"] = excitation_for(
                bench.config.brake, abs(torque_Nm), 2 * np.pi * SPEED_Hz
            )
            yield bench.run(self._setpoint, BLOCK_S * bench.config.loop.rate_Hz)[0]


def gains_against_others(alpha: Sequence[float]) -> np.ndarray:
    """Return the logarithm of each gain less the mean of the two others (3,)."""
    log = np.log(alpha)
    return np.asarray(1.5 * (log - log.mean()))


def alpha_of(found: TrackedCalibration) -> np.ndarray:
    """Return alpha (3,) as it is tracked."""
    values = {one.name: one.value for one in found.quantities}
    return np.array([values[f"alpha-{phase}"] for phase in "abc"])


def departed(found: TrackedCalibration | None) -> list[str]:
    """Return the names of the quantities that have departed."""
    return [one.name for one in found.quantities if one.departed] if found else []


def operating(seed: int, config: Config) -> tuple[Operation, Calibration, RigTruth]:
    """Return the operation of a rig, the calibration in force and what is true of the rig."""
    truth, calibration = rig(seed)[0], stated_calibration(seed, config)
    return Operation(VirtualBench(config, truth, seed, calibration)), calibration, truth


@dataclass(frozen=True)
class Drift:
    """One gain drifting: errors and half-widths (looks,) of what is tracked of it against the
    others; found_s: when the finding was there, after the drift began, nan for never; names: of
    all that departed."""

    phase: int
    error: np.ndarray
    half_width: np.ndarray
    found_s: float
    names: tuple[str, ...]


def drift(seed: int) -> Drift:
    """Let the gain of one phase of a rig drift for an hour."""
    operation, calibration, truth = operating(seed, load())
    tracker = CalibrationTracker(operation.bench.config, calibration, MEMORY_S)
    phase, sign = seed % 3, 1 - 2 * (seed // 3 % 2)
    for block in operation.blocks(WARM_UP_S):
        tracker.take(block)
    error, half_width, found_s, names = [], [], np.nan, set[str]()
    for begin_s in range(0, 3600, LOOK_S):
        now = truth
        for second, block in enumerate(operation.blocks(LOOK_S)):
            tracker.take(block)
            now = with_drift(truth, phase, sign * DRIFT_PER_H * (begin_s + second + 1) / 3600)
            operation.bench.alter(now)
        found = tracker.tracked()
        assert found is not None
        off = gains_against_others(alpha_of(found)) - gains_against_others(now.inverter.alpha)
        mine = next(one for one in found.quantities if one.name == f"alpha-{'abc'[phase]}")
        error.append(off[phase])
        half_width.append(1.5 * mine.half_width / mine.value)
        names |= set(departed(found))
        if f"alpha-{'abc'[phase]}" in names and np.isnan(found_s):
            found_s = begin_s + LOOK_S
    return Drift(phase, np.array(error), np.array(half_width), found_s, tuple(sorted(names)))


def judge_drift(found: Sequence[Drift]) -> tuple[list[str], list[str]]:
    """Return lines on the drifts, and what was not kept."""
    lines, failures = [], []
    for one in found:
        off = 100 * np.abs(one.error)
        inside = 100 * np.mean(np.abs(one.error) <= one.half_width)
        lines.append(
            f"drift of phase {'abc'[one.phase]}: off by {off.max():.3f} % at most, "
            f"{off[-1]:.3f} % after the hour, in its interval of +-"
            f"{100 * np.median(one.half_width):.3f} % at {inside:.0f} % of the looks; finding "
            f"after {one.found_s / 60:.0f} min: {', '.join(one.names) or 'none'}"
        )
        if others := set(one.names) - {f"alpha-{'abc'[one.phase]}"}:
            failures.append(f"found to have departed, too: {', '.join(sorted(others))}")
        if off.max() > 100 * FOLLOWED:
            failures.append(f"a drift is followed within {off.max():.3f} % only")
        if np.isnan(one.found_s):
            failures.append("a drift by 1 % raises no finding")
    inside = np.mean([np.abs(one.error) <= one.half_width for one in found])
    if inside < COVERAGE:
        failures.append(f"{100 * inside:.0f} % of the intervals hold the drifting gain")
    return lines, failures


def quiet(seed: int) -> tuple[int, list[str]]:
    """Return the number of looks in quiet hours, and what was found to have departed."""
    operation, calibration, _ = operating(seed, load())
    tracker = CalibrationTracker(operation.bench.config, calibration, MEMORY_S)
    looks, names = 0, []
    for _ in range(0, QUIET_H * 3600, LOOK_S):
        for block in operation.blocks(LOOK_S):
            tracker.take(block)
        found = tracker.tracked()
        looks += found is not None
        names += departed(found)
    return looks, names


def judge_quiet(found: Sequence[tuple[int, list[str]]]) -> tuple[list[str], list[str]]:
    """Return lines on the quiet hours, and what was not kept."""
    lines = [
        f"{QUIET_H} quiet hours: {looks} looks, {len(names)} findings {sorted(set(names))}"
        for looks, names in found
    ]
    failures = ["a finding in quiet hours"] * any(names for _, names in found)
    failures += ["nothing was tracked"] * any(looks == 0 for looks, _ in found)
    return lines, failures


def judge_cost() -> tuple[list[str], list[str]]:
    """Return a line on the share of a core at 5 kHz, and whether it is too much.

    As the tracker's process takes and reports, once as many windows are kept as ever will be.
    """
    config = load()
    config = config.model_copy(update={"loop": config.loop.model_copy(update={"rate_Hz": 5000})})
    operation, calibration, _ = operating(1, config)
    tracker = CalibrationTracker(config, calibration, MEMORY_S)
    full_s, report_s = round(FORGOTTEN * MEMORY_S), round(1e-9 * REPORT_NS)
    taking_s, reports_s = 0.0, list[float]()
    for second, block in enumerate(operation.blocks(full_s + COST_S)):
        before_s = process_time()
        tracker.take(block)
        between_s = process_time()
        if second >= full_s:
            taking_s += between_s - before_s
            if second % report_s == 0:
                tracker.tracked()
                reports_s.append(process_time() - between_s)
    share = (taking_s + sum(reports_s)) / COST_S
    line = (
        f"at 5 kHz: {1e6 * taking_s / COST_S / 5000:.2f} us a tick, "
        f"{1e3 * np.mean(reports_s):.0f} ms a report; {100 * share:.1f} % of a core with a report "
        f"each {report_s} s"
    )
    return [line], [f"{100 * share:.1f} % of a core"] * (share > SHARE)


PARTS = ("drift", "quiet", "cost")


def main(*parts: str) -> int:
    """Run the parts, print what they show, return the exit code."""
    failed = False
    with processors() as pool:
        judges = {
            "drift": lambda: judge_drift(list(pool.map(drift, seeds.several(DRIFT_RIGS)))),
            "quiet": lambda: judge_quiet(list(pool.map(quiet, seeds.several(QUIET_RIGS)))),
            "cost": judge_cost,
        }
        for part in parts or PARTS:
            lines, failures = judges[part]()
            for line in (*lines, *(f"NOT KEPT: {failure}" for failure in failures)):
                print(line, flush=True)
            failed = failed or bool(failures)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
