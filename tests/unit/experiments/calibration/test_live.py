"""A calibration under way: the plan ends by it when it is good enough, and only then."""

from collections.abc import Mapping
from functools import partial

import numpy as np
import pytest

from motord.config import load
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.live import LiveCalibration
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.plans import build
from motord.identification.operating_points import PointData, split
from motord.rig.truth import EncoderHarmonic, RigTruth
from motord.rig.truth import load as load_truth
from motord.sequencing import Plan
from motord.sequencing.observation import Precision
from motord.virtual import VirtualBench, run_plan

CONFIG = load()
TARGETS = {"alpha_percent": 0.1, "beta_A": 0.03, "cogging_percent": 1.5}
EASY = {"alpha_percent": 0.5, "beta_A": 0.2, "cogging_percent": 3.0}


def eccentric(degrees: float) -> RigTruth:
    truth = load_truth()
    error = EncoderHarmonic(order=1, amplitude_rad=np.radians(degrees), phase_rad=0.3)
    encoder = truth.encoder.model_copy(update={"errors": (error,)})
    return truth.model_copy(update={"encoder": encoder})


def ran(plan: Plan, truth: RigTruth | None) -> tuple[list[dict], np.ndarray, float]:
    """Return the points that were taken, all ticks, and the virtual time that it took (s)."""
    bench, blocks = VirtualBench(CONFIG, truth, seed=3), []
    points = run_plan(bench, plan, lambda ticks, _: blocks.append(ticks))
    return points, np.concatenate(blocks), bench.t_s


def calibrated(points: list[PointData]) -> CalibrationResult:
    again = partial(iter, points)
    calibrator = Calibrator(CONFIG.motor, CONFIG.torque_sensor, again, CONFIG.accuracy)
    for point in points:
        calibrator.add(point)
    return calibrator.joint()


@pytest.fixture(scope="module")
def good() -> tuple[Plan, list[dict], np.ndarray, float]:
    plan = build("calibrate", CONFIG, TARGETS)
    return plan, *ran(plan, None)


def test_it_ends_when_the_targets_are_reached_and_they_are(
    good: tuple[Plan, list[dict], np.ndarray, float],
) -> None:
    plan, points, ticks, seconds = good
    assert 4 <= len(points) < len(plan.points)
    assert seconds < plan.seconds
    found = calibrated(list(split(ticks, points))).target_half_widths
    assert found.keys() >= TARGETS.keys()
    for name, target in TARGETS.items():
        assert found[name] <= 1.3 * target


def seen_of(
    points: list[dict], ticks: np.ndarray, targets: Mapping[str, float], block: int
) -> list[Precision]:
    """Return what each capture adds; its ticks come in blocks."""
    live, seen, first = LiveCalibration(CONFIG, targets), [], 0
    for point in points:
        end = int(np.searchsorted(ticks["tick"], point["tick_end"], side="right"))
        for begin in range(first, end, block):
            live.take(ticks[begin : min(begin + block, end)])
        seen.append(live.captured(point))
        first = end
    return seen


def test_what_is_known_comes_with_the_captures_whatever_the_blocks(
    good: tuple[Plan, list[dict], np.ndarray, float],
) -> None:
    _, points, ticks, _ = good
    seen = seen_of(points, ticks, TARGETS, 50)
    assert seen == seen_of(points, ticks, TARGETS, 1777)
    assert [one.captures for one in seen] == list(range(1, len(points) + 1))
    assert "too few for standard errors" in seen[0].obstacle
    assert not seen[0].half_widths
    assert [one.reaches(TARGETS) for one in seen] == [False] * (len(points) - 1) + [True]
    assert seen[-1].half_widths.keys() >= {"ripple_percent", *TARGETS}


def test_a_poor_capture_counts_for_nothing(
    good: tuple[Plan, list[dict], np.ndarray, float],
) -> None:
    _, points, ticks, _ = good
    poor = [*points[:-1], {**points[-1], "quality": "noisy"}]
    last = seen_of(poor, ticks, TARGETS, 500)[-1]
    assert last.captures == len(points)
    assert not last.half_widths
    assert not last.reaches(TARGETS)


def test_a_serious_finding_lets_it_go_on_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = build("calibrate", CONFIG, {**EASY, "time_limit_s": 20})
    points, ticks, _ = ran(plan, eccentric(0.5))
    assert len(points) >= len(plan.points) - 1  # the time may be short for the last
    last = seen_of(points, ticks, EASY, 500)[-1]
    assert "findings: " in last.obstacle
    assert not last.reaches(EASY)
    # until the whole analysis is repeated, what it said holds
    monkeypatch.setattr("motord.experiments.calibration.estimate.live.AGAIN", 2.0)
    analysed, joint = [], Calibrator.joint

    def counted(self: Calibrator) -> CalibrationResult:
        analysed.append(self)
        return joint(self)

    monkeypatch.setattr(Calibrator, "joint", counted)
    known = [one for one in seen_of(points, ticks, EASY, 500) if one.half_widths]
    first = next(n for n, one in enumerate(known) if one.obstacle)
    assert not any(one.reaches(EASY) for one in known)
    assert {one.obstacle for one in known[first:]} == {known[first].obstacle}
    assert len(analysed) == 1 < len(known) - first
    # the same plan ends early on a bench as the model has it
    assert len(ran(plan, None)[0]) < len(points)
