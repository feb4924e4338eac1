"""Operating points that can, and that cannot, separate gains from cogging torque."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from motord.config import AccuracyConfig, TorqueSensorConfig
from motord.experiments.calibration.estimate.checks import check_points, common_gain_finding
from motord.experiments.calibration.estimate.turn_products import TurnProducts, accumulate
from motord.identification import IdentifyError
from motord.identification.basis import Basis
from motord.identification.operating_points import Samples
from tests.unit.identification.synthetic_bench import motor

PER_TURN = 128
PHASES = 2 * np.pi * np.arange(3) / 3
BALANCED = (1.0, 1.0, 1.0)
HALVED = (BALANCED, (0.5, 1.0, 1.0), (1.0, 0.5, 1.0), (1.0, 1.0, 0.5))
BASIS = Basis.of(motor(counts=64), (16,))


Point = Callable[[], TurnProducts]


def point(torque_Nm: float, gain: tuple[float, float, float] = BALANCED, turns: int = 2) -> Point:
    """Return what computes a point, which its test does: not every process that collects tests."""
    return partial(products, torque_Nm, gain, turns)


def products(torque_Nm: float, gain: tuple[float, float, float], turns: int) -> TurnProducts:
    angle_rad = 2 * np.pi * np.arange(turns * PER_TURN) / PER_TURN
    i_A = 3 * torque_Nm * np.array(gain) * np.cos(angle_rad[:, None] - PHASES)
    return accumulate(
        Samples(
            torque_set_Nm=torque_Nm,
            speed_set_Hz=1.0,
            compensate=0,
            t_s=angle_rad / (2 * np.pi),
            count=np.arange(angle_rad.size) * 64 // PER_TURN % 64,
            torque_Nm=np.sin(16 * angle_rad),
            i_A=i_A,
            command_A=i_A,
            turns=tuple(pairwise(range(0, angle_rad.size + 1, PER_TURN))),
        ),
        BASIS,
        TorqueSensorConfig(),
    )


@pytest.mark.parametrize(
    "points",
    [
        [point(5.0, gain) for gain in HALVED],
        [point(sign * 5.0, gain) for sign, gain in zip((1, -1, 1, -1), HALVED, strict=True)],
        [point(5.0, turns=6), point(5.0, (1.0, 1.0, 0.8))],
        [point(5.0, turns=4), point(4.1, turns=4)],
    ],
    ids=["phase by phase", "both directions", "one phase", "two torques"],
)
def test_a_phase_with_more_and_with_less_current_will_do(points: Sequence[Point]) -> None:
    check_points([one() for one in points])


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ([point(5.0, turns=8)], r"same torque \(5 to 5 Nm\).*\(gain_steps\)"),
        ([point(5.0), point(-5.0)] * 2, r"phase gains and cogging .*\(gain_steps\)"),
        ([point(5.0, turns=6), point(5.0, (0.9, 1.0, 1.0))], r"\(gain_steps\)"),
        ([point(5.0, turns=4), point(4.3, turns=4)], r"4\.3 to 5 Nm.*\(gain_steps\)"),
        ([point(5.0, HALVED[1]), point(5.0)], "4 whole turns in all: too few .* at least 8"),
        ([point(5.0, (0.0, 1.0, 1.0), 4), point(3.0, (0.0, 1.0, 1.0), 4)], "phase a is dead"),
        ([], "no good operating point"),
    ],
)
def test_the_others_are_refused_with_what_is_missing(
    points: Sequence[Point], expected: str
) -> None:
    with pytest.raises(IdentifyError, match=expected):
        check_points([one() for one in points])


@pytest.mark.parametrize(
    ("delta_epsilon", "stderr", "torque_gain_percent", "seen"),
    [
        (1.14, 1e-3, 0.5, False),
        (1.42, 1e-3, 0.5, True),
        (0.71, 1e-3, 0.5, True),
        (1.2, 0.05, 0.5, False),  # not beyond its own interval
        (1.42, 1e-3, 50.0, False),  # no more than [accuracy] allows
        (1.0, None, 0.5, False),  # assumed
    ],
)
def test_a_common_gain_that_no_sensor_has_is_a_finding(
    delta_epsilon: float, stderr: float | None, torque_gain_percent: float, seen: bool
) -> None:
    result = SimpleNamespace(
        delta_epsilon=delta_epsilon, delta_epsilon_stderr=stderr, degrees_of_freedom=None
    )
    accuracy = AccuracyConfig(torque_gain_percent=torque_gain_percent)
    found = list(common_gain_finding(result, accuracy))
    assert [(one.name, one.severity) for one in found] == [("common-gain", "serious")] * seen
