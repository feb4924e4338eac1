"""What a calibration may ask of a bench, against what the kernel makes of it."""

from datetime import UTC, datetime

import numpy as np
import pytest

from motord.calibration import CalibratedMotor, Calibration, CalibrationError
from motord.calibration.current_check import GAIN_MAX, check_currents, rest_currents_A
from motord.config import Config, load
from motord.control.reference import phase_currents

BENCH = load()


def made(bench: Config, **changes: object) -> Calibration:
    angle_rad = 2 * np.pi * np.arange(bench.motor.counts) / bench.motor.counts
    values: dict[str, object] = {
        "created": datetime(2026, 1, 1, tzinfo=UTC),
        "motor": CalibratedMotor.of(bench.motor),
        "method": "joint",
        "alpha": (0.8, 1.118, 1.118),
        "alpha_stderr": (0.001,) * 3,
        "beta_A": (1.0, -0.5, -0.5),
        "beta_stderr_A": (0.01,) * 3,
        "tau_cog_Nm": tuple(0.33 * np.sin(48 * angle_rad) + 0.08 * np.sin(16 * angle_rad + 0.6)),
        "condition_number": 10.0,
    }
    return Calibration(**{**values, **changes})


@pytest.mark.parametrize("connection", ["independent", "star"])
@pytest.mark.parametrize("delta_epsilon", [0.5, 1.3])
def test_no_current_at_zero_torque_is_above_what_is_stated(
    connection: str, delta_epsilon: float
) -> None:
    motor = BENCH.motor.model_copy(update={"connection": connection})
    bench = BENCH.model_copy(update={"motor": motor})
    calibration = made(bench, delta_epsilon=delta_epsilon)
    flowing_A = np.array(
        [
            phase_currents(-torque_Nm, *map(float, k), int(connection == "star"))
            for torque_Nm, k in zip(calibration.tau_cog_Nm, motor.back_emf_table(), strict=True)
        ]
    )
    gain = np.array(calibration.alpha) * delta_epsilon
    asked_A = np.abs((flowing_A - calibration.beta_A) / gain).max(axis=0)
    stated_A = rest_currents_A(calibration, bench)
    assert (asked_A <= stated_A * (1 + 1e-9)).all()
    assert (stated_A < 1.2 * asked_A).all()


def test_what_is_found_on_a_bench_may_be_asked_for() -> None:
    check_currents(made(BENCH), BENCH)


def test_the_limit_is_what_may_flow_for_ever() -> None:
    calibration = made(BENCH, alpha=(1.0,) * 3, tau_cog_Nm=(0.0,) * BENCH.motor.counts)
    limit_A = BENCH.limits.i2t_current_A
    check_currents(calibration.model_copy(update={"beta_A": (0.0, -limit_A, 0.0)}), BENCH)
    above = calibration.model_copy(update={"beta_A": (0.0, -1.001 * limit_A, 0.0)})
    with pytest.raises(CalibrationError, match="in phase b at zero torque"):
        check_currents(above, BENCH)


@pytest.mark.parametrize("factor", [1.001, 1 / 1.001])
def test_gains_of_a_wrong_unit_are_refused(factor: float) -> None:
    gain = GAIN_MAX if factor > 1 else 1 / GAIN_MAX
    none = {"beta_A": (0.0,) * 3, "tau_cog_Nm": (0.0,) * BENCH.motor.counts}
    check_currents(made(BENCH, alpha=(gain, 1.0, 1.0), **none), BENCH)
    with pytest.raises(CalibrationError, match=r"alpha_a delta_epsilon = .* outside 0\.25 to 4"):
        check_currents(made(BENCH, alpha=(gain * factor, 1.0, 1.0), **none), BENCH)
