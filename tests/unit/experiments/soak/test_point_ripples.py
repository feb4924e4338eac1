"""Noise of a turn, and the findings of set-points of which each repetition has a ripple."""

from dataclasses import replace

import numpy as np
import pytest

from motord.experiments.soak.point_ripples import (
    changed_behind_noise,
    noise_rms_Nm,
    ripple_findings,
)
from motord.identification.point_ripple import AsynchronousLine, PointRipple
from motord.identification.signal_condition import SignalFault

NONE = np.empty(0)
HIDDEN = PointRipple(
    1.0, 1.0, 0, 4, 0.10, 0.15, 0.2, NONE, NONE, NONE, NONE, noise_stderr_percent=0.15
)
SEEN = replace(HIDDEN, rms_percent=0.9, stderr_percent=0.05, noise_stderr_percent=0.05)


@pytest.mark.parametrize("turns", [2, 3, 4, 5])
def test_noise_of_a_turn_does_not_depend_on_how_many_there_are(turns: int) -> None:
    parts = np.random.default_rng(1).normal(size=(2, turns, 20_000))
    lines_Nm = 0.1 * (parts[0] + 1j * parts[1])
    even_odd_Nm = np.array([lines_Nm[first::2].mean(axis=0) for first in (0, 1)])
    ripple = replace(HIDDEN, turns=turns, even_odd_Nm=even_odd_Nm)
    assert noise_rms_Nm(ripple) == pytest.approx(0.1 * 20_000**0.5, rel=0.01)


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({}, ["noise-hides-ripple"]),
        ({"leakage_percent": 0.28, "stderr_percent": 0.3}, ["noise-hides-ripple"]),
        (
            {"faults": (SignalFault("torque_Nm", "clipped", 0.1),)},
            ["noise-hides-ripple", "torque-clipped"],
        ),
        (
            {"turns": 1, "stderr_percent": None, "noise_stderr_percent": None},
            ["one-turn", "noise-hides-ripple"],
        ),
    ],
)
def test_a_set_point_that_noise_hides_in_a_repetition_is_a_finding(
    changes: dict[str, object], names: list[str]
) -> None:
    found = ripple_findings(at("point 1", [HIDDEN, replace(SEEN, **changes)]))
    assert [one.name for one in found] == names
    [hidden] = [one for one in found if one.name == "noise-hides-ripple"]
    assert "below 0.39 %; no slope of it is stated" in hidden.meaning


def test_a_set_point_is_named_once_with_the_worst_of_its_repetitions() -> None:
    hum = {
        "asynchronous_percent": 0.5,
        "asynchronous_lines": (AsynchronousLine(50.0, 0.03, 0.001),),
    }
    ripples = [
        replace(one, **hum, faults=(SignalFault("torque_Nm", "clipped", share),))
        for one, share in ((HIDDEN, 0.3), (SEEN, 0.1))
    ]
    found = {one.name: one for one in ripple_findings(at("point 1", ripples))}
    assert found["asynchronous-line"].meaning.startswith("1 Nm, 1 Hz: the torque has a line")
    assert found["torque-clipped"].value == pytest.approx(30.0)


def test_faults_of_all_repetitions_are_named_whichever_is_known_worst() -> None:
    faults = SignalFault("torque_Nm", "clipped", 0.1), SignalFault("encoder_count", "stuck", 0.5)
    ripples = [
        replace(SEEN, faults=(fault,), stderr_percent=stderr)
        for fault, stderr in zip(faults, (0.05, 0.06), strict=True)
    ]
    found = [one.name for one in ripple_findings(at("point 1", ripples))]
    assert found == ["asynchronous-lines-unsearched", "torque-clipped", "encoder-stuck"]


def test_points_of_one_set_point_are_counted_each() -> None:
    ripples = [*at("point 1", [HIDDEN] * 3), *at("point 2", [HIDDEN] * 3)]
    [found] = ripple_findings(ripples)
    assert "1 Nm, 1 Hz (2 times): the noise" in found.meaning


@pytest.mark.parametrize(
    ("series", "changed"),
    [
        ([HIDDEN, SEEN], True),
        ([SEEN, HIDDEN], True),
        ([HIDDEN, replace(SEEN, rms_percent=0.45)], False),
        ([HIDDEN, replace(SEEN, stderr_percent=0.3)], False),
        ([HIDDEN, replace(HIDDEN, rms_percent=0.2, stderr_percent=0.5), SEEN], False),
        ([HIDDEN, replace(SEEN, stderr_percent=None, noise_stderr_percent=None)], False),
        ([replace(SEEN, rms_percent=0.2), SEEN], False),
    ],
)  # fmt: skip
def test_a_ripple_that_is_larger_than_noise_can_have_hidden_has_changed(
    series: list[PointRipple], changed: bool
) -> None:
    found = list(changed_behind_noise(at("point 1, 1 Nm, 1 Hz", series)))
    assert [one.name for one in found] == ["ripple-changed"] * changed
    for one in found:
        place = 1 + series.index(SEEN)
        assert f"point 1, 1 Nm, 1 Hz, most in repetition {place}: " in one.meaning
        assert (one.value, one.limit) == pytest.approx((0.776, 0.357), abs=0.001)


def at(label: str, series: list[PointRipple]) -> list[tuple[str, int, PointRipple]]:
    return [(label, number, one) for number, one in enumerate(series, 1)]


def test_points_of_one_set_point_are_judged_each_by_itself() -> None:
    """Of 41 points of a sensitivity, noise hid one, another had its ripple all the time."""
    points = at("point 1, 1 Nm, 1 Hz", [HIDDEN] * 3) + at("point 2, 1 Nm, 1 Hz", [SEEN] * 3)
    assert not list(changed_behind_noise(points))


def test_of_many_repetitions_one_beyond_its_interval_is_chance() -> None:
    """Intervals of 95 % each made a finding in one of eight soaks of 200 repetitions."""
    seen = replace(SEEN, rms_percent=0.55)
    assert list(changed_behind_noise(at("point 1", [HIDDEN, seen])))
    assert not list(changed_behind_noise(at("point 1", [HIDDEN] * 100 + [seen] * 100)))
