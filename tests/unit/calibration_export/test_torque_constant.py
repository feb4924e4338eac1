"""Torque of a current along q, and what the drive does not take, against sums over the phases."""

import numpy as np
import pytest

from motord.calibration.export import FORMATS, DriveFrame, exported, torque_per_ampere
from motord.calibration.export.residual import gain_ripple, offset_ripple_Nm
from motord.config import BackEmfHarmonic, MotorConfig
from tests.unit.calibration_export.cases import CONSTANT, COUNTS, NM_PER_A, calibration

PHASES_RAD = np.arange(3) * 2 * np.pi / 3
ANGLES_RAD = 2 * np.pi * np.arange(COUNTS) / COUNTS


def motor(*harmonics: BackEmfHarmonic, **changes: object) -> MotorConfig:
    values: dict[str, object] = {
        "name": "m", "pole_pairs": 8, "slots": 48, "counts": COUNTS, "rated_torque_Nm": 6.0,
        "connection": "star", "back_emf": harmonics,
    }  # fmt: skip
    return MotorConfig(**{**values, **changes})


FUNDAMENTAL = BackEmfHarmonic(order=1, amplitude_V_s_per_rad=0.206, phase_rad=0.3)


@pytest.mark.parametrize("changes", [{}, {"phase_order": "acb"}, {"encoder_offset_rad": 1.1}])
def test_a_sinusoidal_motor_has_one_and_a_half_times_its_back_emf(changes: dict) -> None:
    table = motor(FUNDAMENTAL, **changes).back_emf_table()
    assert torque_per_ampere(table, 8) == pytest.approx(np.full(COUNTS, 1.5 * 0.206))


def test_harmonics_of_the_back_emf_are_over_the_turn() -> None:
    fifth = BackEmfHarmonic(order=5, amplitude_V_s_per_rad=0.02, phase_rad=0.1)
    found = torque_per_ampere(motor(FUNDAMENTAL, fifth).back_emf_table(), 8)
    expected = np.zeros(COUNTS)
    for phase_rad in PHASES_RAD:
        own = 8 * ANGLES_RAD - phase_rad
        k = 0.206 * np.sin(own + 0.3) + 0.02 * np.sin(5 * own + 0.1)
        expected += k * np.sin(own + 0.3)
    assert found == pytest.approx(expected)
    assert np.ptp(found) > 0.05


def test_what_gains_and_offsets_make() -> None:
    alpha, beta_A = calibration().alpha, calibration().beta_A
    amplitude = NM_PER_A / 1.5
    waves = np.sin(8 * ANGLES_RAD[:, None] - PHASES_RAD)
    by_gains = amplitude * (waves**2 * alpha).sum(axis=1)
    ripple = by_gains.std() / by_gains.mean()
    assert gain_ripple(calibration()) == pytest.approx(ripple, rel=1e-9)
    by_offsets_Nm = amplitude * (waves * beta_A).sum(axis=1)
    assert offset_ripple_Nm(calibration(), CONSTANT) == pytest.approx(by_offsets_Nm.std(), rel=1e-9)
    lines = exported(calibration(), FORMATS["moteus"], DriveFrame(), CONSTANT).not_taken
    assert f"makes {100 * ripple:.3g} % RMS of any torque, order 16" in lines[0]
    assert f"makes {1e3 * by_offsets_Nm.std():.4g} mNm RMS, order 8" in lines[1]


def test_without_a_constant_the_offsets_are_named_without_a_torque() -> None:
    lines = exported(calibration(), FORMATS["odrive"], DriveFrame(), None).not_taken
    assert lines[1].endswith("A; a drive that has them makes order 8")
