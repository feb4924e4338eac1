"""The learned torque in the calibration file: additive, checked, part of the id."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from motord.calibration import CalibrationError, from_json, load
from motord.learned import LearnedPoint, LearnedTorque, Verified
from tests.unit.test_calibration import make

NOW = datetime(2026, 4, 1, tzinfo=UTC)


def point(value: float, orders: int = 3) -> LearnedPoint:
    values = (value,) * orders
    best = Verified(cos_Nm=values, sin_Nm=values, rms_percent=0.2, stderr_percent=0.01)
    return LearnedPoint(cos_Nm=values, sin_Nm=values, gain=0.7, best=best)


def learned(**changes: object) -> LearnedTorque:
    values: dict[str, object] = {
        "torques_Nm": (1.0, 2.0),
        "speeds_Hz": (0.5, 0.7, 1.0),
        "orders": (8, 16, 24),
        "points": tuple(point(0.001 * n) for n in range(6)),
        "runs": ("learn-1.mcap",),
    }
    return LearnedTorque(**{**values, **changes})


def test_a_calibration_without_it_is_what_it_was() -> None:
    content = make().to_json()
    assert "learned" not in content
    assert from_json(content, "c").id == make().id == "3897e22b0550efa9"


def test_it_survives_the_file_and_changes_the_id(tmp_path: Path) -> None:
    made = make().with_learned(learned(), NOW)
    assert made.id != make().id
    assert made.created == NOW
    made.save(tmp_path / "c.json")
    assert load(tmp_path / "c.json") == made
    other = made.with_learned(learned(points=(point(0.002),) * 6), NOW)
    assert other.id != made.id


def test_coefficients_are_by_torque_speed_order() -> None:
    coefficients = learned().coefficients_Nm()
    assert coefficients.shape == (2, 3, 3, 2)
    assert (coefficients[1, 2] == 0.005).all()
    assert list(learned().by_place)[4] == (2.0, 0.7)
    np.testing.assert_allclose(point(0.3).line_Nm, 0.3 * (1 - 1j))


def test_a_correction_too_large_to_be_a_rest_is_refused() -> None:
    content = make().to_json()
    content["learned"] = learned(points=(point(0.5),) * 6).model_dump(mode="json")
    with pytest.raises(CalibrationError, match=r"learned torque of 2\.12 Nm, at most 1\.5 Nm"):
        from_json(content, "c")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"torques_Nm": (2.0, 1.0)}, "torques_Nm do not rise"),
        ({"speeds_Hz": (0.5, 0.5, 1.0)}, "speeds_Hz do not rise"),
        ({"orders": (8, 24, 24)}, "learned orders do not rise"),
        ({"points": (point(0.0),) * 5}, "5 learned points, the mesh has 6"),
        ({"points": (point(0.0, 2),) * 6}, "not one value for each"),
        ({"torques_Nm": tuple(range(1, 18))}, "at most 16"),
    ],
)
def test_what_does_not_fit_together_is_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        learned(**changes)
