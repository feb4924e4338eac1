"""Faults of the torque of steps: none where a flat step is of one level of a converter."""

import numpy as np
import pytest

from motord.config import AccelerationConfig, TorqueSensorConfig
from motord.experiments.inertia.acceleration import accelerate
from tests.unit.experiments.inertia.inertia_runs import named
from tests.unit.experiments.inertia.step_simulator import Rotor, steps

LEVEL_NM = 0.01


@pytest.mark.parametrize("highpass_s", [0.0, 2.0])
@pytest.mark.parametrize("noise_Nm", [1e-3, 2e-3, 4e-3])
def test_a_torque_in_levels_is_neither_cut_off_nor_frozen(
    highpass_s: float, noise_Nm: float
) -> None:
    """Without cogging torque, which moves it from level to level."""
    rotor = Rotor(cogging=(), noise_Nm=noise_Nm, highpass_s=highpass_s or 1e9)
    data = steps(rotor, 8, np.random.default_rng(3))
    for one in data:
        one["torque_Nm"] = np.rint(one["torque_Nm"] / LEVEL_NM) * LEVEL_NM
    sensor = TorqueSensorConfig(highpass_time_constant_s=highpass_s)
    found = accelerate(named(data), rotor.counts, sensor, AccelerationConfig())
    assert not {one.name for one in found.findings} & {"torque-clipped", "torque-frozen"}
    assert found.inertia_kg_m2 == pytest.approx(rotor.inertia_kg_m2, abs=found.half_width_kg_m2)
