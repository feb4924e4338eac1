"""Mains hum that meets an order at the speed of the points with single errors."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from motord.experiments.captures_left_out import EveryCapture
from motord.experiments.sensitivity import estimate
from motord.experiments.subject import Subject
from motord.identification.operating_points import PointData
from tests.unit.identification.synthetic_bench import Bench

TORQUE_Nm, HUM_Nm = 3.0, 0.06
MIXED = {"gain": [0.8, 1.118, 1.118], "offset_A": [1.0, -0.5, -0.5]}
BENCH = Bench(speed_ripple=0.0, fine_Hz=1000)
SUBJECT = Subject("made up", BENCH.motor, BENCH.sensor)


def captures(hum_Nm: float, *_: object) -> Iterator[PointData]:
    """Yield two points with single errors at 1 turn/s, and two to calibrate from again."""
    places = [(1.0, {"cogging": 0.8}), (1.0, {"cogging": 1.2}), (0.6, MIXED), (0.9, MIXED)]
    for seed, (speed_Hz, induced) in enumerate(places):
        point = replace(BENCH.point(TORQUE_Nm, speed_Hz, 6.3, seed), induced=induced)
        phase_rad = 2e-9 * np.pi * 50 * point.ticks["t_ns"] + seed
        point.ticks["torque_Nm"] += hum_Nm * np.sin(phase_rad)
        yield point


def test_hum_that_is_order_50_is_known_from_the_points_to_calibrate_from_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = []
    for hum_Nm in (0.0, HUM_Nm):
        monkeypatch.setattr(estimate, "captures", partial(captures, hum_Nm))
        run = SimpleNamespace(plan_metadata={})
        found.append(estimate.measured_ripples([run], SUBJECT, EveryCapture()))
    assert [induced.cogging for _, induced, _ in found[1]] == [0.8, 1.2]
    for (before, *_), (after, *_) in zip(*found, strict=True):
        assert not before.asynchronous_lines
        [line] = after.asynchronous_lines
        assert line.frequency_Hz == pytest.approx(50.0, abs=0.05)
        off = abs(after.rms_percent - before.rms_percent)
        assert 1.96 * after.noise_stderr_percent < off < 1.96 * after.stderr_percent
