"""What a calibration may ask of a bench, against what the kernel makes of it."""

from datetime import UTC, datetime

import numpy as np
import pytest

from motord.calibration import CalibratedMotor, Calibration, CalibrationError
from motord.config import Config, load
from motord.control import parameters
from motord.control.reference import currents_along_q, phase_currents
from motord.section import LARGEST
from motord.service.bench.rest_currents import GAIN_MAX, check_rest_currents, rest_currents_A
from tests.unit.control.test_park import HARMONICS, star

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
def test_currents_at_zero_torque_are_those_of_the_kernel(
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
    asked_A = np.abs(
        [(flowing_A - calibration.beta_A) / gain, flowing_A, [calibration.beta_A / gain] * 4096]
    ).max(axis=(0, 1))
    assert rest_currents_A(calibration, bench) == pytest.approx(asked_A)


def test_what_is_found_on_a_bench_may_be_asked_for() -> None:
    check_rest_currents(made(BENCH), BENCH)


def test_of_a_drive_that_makes_current_along_q_they_are_those_of_the_kernel() -> None:
    bench = star(q_only=True, dq={"d_axis_rad": 0.3, "direction": -1}, back_emf=HARMONICS)
    calibration = made(bench, alpha=(0.6, 1.4, 1.2), beta_A=(2.0, -1.5, -0.5), delta_epsilon=1.1)
    built, k, cogging_Nm, _ = parameters.build(bench, calibration)
    angles_rad = 2 * np.pi * np.arange(len(k)) / len(k)
    asked_A = [
        currents_along_q(built[0], compensate, -torque_Nm, angle_rad, tuple(map(float, row)))
        for compensate in (True, False)
        for torques_Nm in (cogging_Nm, 0.0 * cogging_Nm)
        for torque_Nm, angle_rad, row in zip(torques_Nm, angles_rad, k, strict=True)
    ]
    assert rest_currents_A(calibration, bench) == pytest.approx(np.abs(asked_A).max(axis=0))


@pytest.mark.parametrize("name", ["i2t_current_A", "current_A"])
def test_the_limit_is_what_may_flow_for_ever_and_what_the_kernel_commands(name: str) -> None:
    limits = BENCH.limits.model_copy(update={"i2t_current_A": 20.0, "current_A": 20.0, name: 5.0})
    bench = BENCH.model_copy(update={"limits": limits})
    calibration = made(BENCH, alpha=(1.0,) * 3, tau_cog_Nm=(0.0,) * BENCH.motor.counts)
    check_rest_currents(calibration.model_copy(update={"beta_A": (0.0, -5.0, 0.0)}), bench)
    above = calibration.model_copy(update={"beta_A": (0.0, -5.005, 0.0)})
    with pytest.raises(CalibrationError, match=f"in phase b at zero torque.* {name} = 5"):
        check_rest_currents(above, bench)


@pytest.mark.parametrize("largest", [{"tau_cog_Nm": (LARGEST,) * 4096}, {"beta_A": (LARGEST,) * 3}])
def test_the_largest_numbers_that_a_file_may_hold_are_refused(largest: dict[str, object]) -> None:
    with pytest.raises(CalibrationError, match="at zero torque"):
        check_rest_currents(made(BENCH, **largest), BENCH)


@pytest.mark.parametrize("factor", [1.001, 1 / 1.001])
def test_gains_of_a_wrong_unit_are_refused(factor: float) -> None:
    gain = GAIN_MAX if factor > 1 else 1 / GAIN_MAX
    none = {"beta_A": (0.0,) * 3, "tau_cog_Nm": (0.0,) * BENCH.motor.counts}
    check_rest_currents(made(BENCH, alpha=(gain, 1.0, 1.0), **none), BENCH)
    with pytest.raises(CalibrationError, match=r"alpha_a delta_epsilon = .* outside 0\.25 to 4"):
        check_rest_currents(made(BENCH, alpha=(gain * factor, 1.0, 1.0), **none), BENCH)
