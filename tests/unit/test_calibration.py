import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from pydantic import ValidationError

from motord.calibration import (
    BoundedQuantity,
    CalibratedMotor,
    Calibration,
    CalibrationError,
    CramerRao,
    Harmonic,
    RmsErrors,
    RmsPoint,
    VarianceShare,
    by_magnitude,
    format_duration,
    load,
)
from motord.config import BackEmfHarmonic, MotorConfig

MOTOR = MotorConfig(
    name="axial",
    serial="7",
    pole_pairs=8,
    slots=48,
    counts=64,
    rated_torque_Nm=6.0,
    connection="star",
    back_emf=(BackEmfHarmonic(order=1, amplitude_V_s_per_rad=0.206),),
)
CREATED = datetime(2026, 3, 1, 12, tzinfo=UTC)


def make(**changes: object) -> Calibration:
    values: dict[str, object] = {
        "created": CREATED,
        "motor": CalibratedMotor.of(MOTOR),
        "method": "joint",
        "runs": ("a.mcap",),
        "alpha": (0.8, 1.118, 1.118),
        "alpha_stderr": (1e-3, 1e-3, 1e-3),
        "beta_A": (1.0, -0.5, -0.5),
        "beta_stderr_A": (1e-2, 1e-2, 1e-2),
        "tau_cog_Nm": tuple(0.1 * n for n in range(64)),
        "tau_cog_harmonics": (
            Harmonic(order=16, amplitude_Nm=0.08, phase_rad=0.1, stderr_Nm=1e-3),
        ),
        "condition_number": 12.0,
    }
    return Calibration(**{**values, **changes})


def test_a_bound_is_kept_and_files_from_before_have_none(tmp_path: Path) -> None:
    bound = CramerRao(
        white_noise_Nm=0.02,
        encoder_noise_Nm=0.005,
        current_noise_Nm=0.008,
        ripple_percent=0.03,
        ripple_upper_percent=0.05,
        quantities=(BoundedQuantity(quantity="ripple", unit="%", bound=0.02, efficiency=0.44),),
        shares=(
            VarianceShare(source="white noise", share=0.6),
            VarianceShare(source="findings", share=0.4),
        ),
    )
    made = make(cramer_rao=bound)
    made.save(tmp_path / "c.json")
    assert load(tmp_path / "c.json").cramer_rao == bound
    assert bound.to_text()[1].endswith("(ripple); most of the rest: findings")
    alone = bound.model_copy(update={"shares": bound.shares[:1]})
    assert alone.to_text()[1].endswith("(ripple)")
    by_chance = bound.quantities[0].model_copy(update={"efficiency": 1.05})
    above = bound.model_copy(update={"quantities": (by_chance,)})
    assert above.to_text()[1].endswith("(ripple), above 1 by chance")
    assert "cramer_rao" not in make().to_json()
    assert make().id != made.id


def test_survives_the_file(tmp_path: Path) -> None:
    made = make()
    made.save(tmp_path / "c.json")
    assert load(tmp_path / "c.json") == made
    assert [p.name for p in tmp_path.iterdir()] == ["c.json"]
    content = json.loads((tmp_path / "c.json").read_text())
    assert content["schema"] == "motord.calibration/1"
    assert content["id"] == made.id


def test_id_is_of_what_is_applied() -> None:
    made = make()
    assert make().id == made.id
    assert make(alpha=(0.81, 1.118, 1.118)).id != made.id
    rms = RmsErrors.of((RmsPoint(torque_Nm=1.0, speed_Hz=0.5, before=5.0, after=0.4),))
    assert made.with_rms_error(rms).id == made.id


def test_rms_summaries() -> None:
    rms = RmsErrors.of(
        (
            RmsPoint(torque_Nm=1.0, speed_Hz=0.5, before=5.0),
            RmsPoint(torque_Nm=2.0, speed_Hz=0.5, before=7.0),
        )
    )
    assert rms.before is not None
    assert (rms.before.mean, rms.before.max) == (6.0, 7.0)
    assert rms.after is None


def test_edited_by_hand_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.json"
    make().save(path)
    path.write_text(path.read_text().replace("0.8,", "0.9,"))
    with pytest.raises(CalibrationError, match=r"c\.json: content does not fit its id"):
        load(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "no valid JSON"),
        ("[]", "names no schema"),
        ('{"schema": "motord.calibration/9"}', "'motord.calibration/9', expected"),
        ('{"schema": "motord.calibration/1"}', "created: Field required"),
    ],
)
def test_what_is_no_calibration_is_said_in_one_line(
    tmp_path: Path, text: str, message: str
) -> None:
    path = tmp_path / "c.json"
    path.write_text(text)
    with pytest.raises(CalibrationError, match=message) as caught:
        load(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_time_without_a_zone_is_refused() -> None:
    with pytest.raises(ValidationError, match=r"created\n.*timezone"):
        make(created=CREATED.replace(tzinfo=None))


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="cannot read it: No such file"):
        load(tmp_path / "none.json")


def test_nan_and_wrong_length_are_refused() -> None:
    with pytest.raises(ValueError, match="finite"):
        make(beta_A=(float("nan"), 0.0, 0.0))
    with pytest.raises(ValueError, match="63 values, the motor 64"):
        make(tau_cog_Nm=(0.0,) * 63)


@pytest.mark.parametrize(
    "change",
    [
        {"name": "other"},
        {"serial": "8"},
        {"slots": 36},
        {"pole_pairs": 6},
        {"counts": 128},
        {"rated_torque_Nm": 7.0},
        {"connection": "independent"},
        {"encoder_direction": -1},
    ],
)
def test_another_motor_is_refused_naming_what_differs(change: dict[str, object]) -> None:
    made = make()
    made.check_motor(MOTOR)
    (name,) = change
    with pytest.raises(CalibrationError, match=f"{name} is .* there and .* here") as caught:
        made.check_motor(MOTOR.model_copy(update=change))
    assert str(caught.value).count(" there and ") == 1


def test_save_failing_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "c.json"
    old = make()
    old.save(path)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(CalibrationError, match="cannot write it: No space left"):
        make(alpha=(0.9, 1.0, 1.1)).save(path)
    monkeypatch.undo()
    assert load(path) == old
    assert [p.name for p in tmp_path.iterdir()] == ["c.json"]


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [
        (0.4, "0 seconds"),
        (1.0, "1 second"),
        (119, "119 seconds"),
        (121, "2 minutes"),
        (7200, "2 hours"),
        (86_400 * 3 + 5, "3 days"),
        (-5, "less than nothing (made in the future: is the clock right?)"),
    ],
)
def test_age_text(seconds: float, expected: str) -> None:
    assert format_duration(seconds) == expected
    assert make().age(CREATED + timedelta(seconds=seconds)) == expected


def test_age_now() -> None:
    assert make(created=datetime.now(UTC)).age().endswith(("second", "seconds"))


def test_a_mesh_in_both_directions_is_shown_by_magnitude_if_no_two_points_become_one() -> None:
    chessboard = {(1.0, 0.5): 1.0, (-3.0, -0.5): 2.0, (-1.0, -0.7): 3.0, (3.0, 0.7): 4.0}
    assert by_magnitude(chessboard) == {
        (1.0, 0.5): 1.0,
        (3.0, 0.5): 2.0,
        (1.0, 0.7): 3.0,
        (3.0, 0.7): 4.0,
    }
    full = {(1.0, 0.5): 1.0, (-1.0, -0.5): 2.0}
    assert by_magnitude(full) == full
