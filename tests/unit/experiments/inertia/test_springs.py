"""Springs: effective mass against the rig's own physics, and the way from frequency to inertia."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from motord.config import OscillationConfig
from motord.experiments.inertia.springs import HEAVY, UNLOADED, SpringSetup, mass_factors
from motord.identification import IdentifyError
from motord.rig.free_decay import inertia_with_springs
from motord.rig.truth.swing import SpringTruth
from tests.unit.experiments.inertia.inertia_runs import nominal_setup, swing_truth


@given(
    inertia=st.floats(5e-3, 0.05),
    mass_kg=st.floats(1e-3, 0.1),
    stiffness=st.floats(20.0, 200.0),
)
@example(inertia=5e-3, mass_kg=0.1, stiffness=50.0)  # they have more inertia than all else
def test_waves_give_back_what_the_rig_swings_with(
    inertia: float, mass_kg: float, stiffness: float
) -> None:
    springs = tuple(
        SpringTruth(
            stiffness_N_per_m=stiffness * (1 + n / 10), lever_m=lever, mass_kg=mass_kg, side=1
        )
        for n, lever in enumerate((0.4, 0.5))
    )
    bar = 0.002
    whole = inertia_with_springs(inertia + bar, springs)
    setup = SpringSetup(
        stiffness_N_per_m=np.array([s.stiffness_N_per_m for s in springs]),
        mass_kg=np.array([s.mass_kg for s in springs]),
        lever=np.array([0, 1]),
        levers_m=np.array([0.4, 0.5]),
        bar_inertia_kg_m2=bar,
    )
    frequency = np.sqrt(setup.stiffness_Nm / whole)
    assert setup.inertia_kg_m2(frequency) == pytest.approx(inertia, rel=1e-6)
    assert setup.frequency_rad_s(inertia) == pytest.approx(frequency, rel=1e-9)
    assert (setup.factors(frequency) >= HEAVY).all()
    assert (setup.factors(frequency) <= UNLOADED).all()


def test_the_limits_of_the_effective_mass() -> None:
    k, m = np.array([100.0]), np.array([0.01])
    w = np.pi / 2 * np.sqrt(k / m)
    assert mass_factors("wave", k, m, w * (1 - 1e-9))[0] == pytest.approx(4 / np.pi**2)
    assert mass_factors("wave", k, m, 1e-3)[0] == pytest.approx(1 / 3)
    steps = mass_factors("wave", k, m, w * np.linspace(0.01, 0.03, 50))
    assert (np.diff(steps) > 0).all()  # no step where the series takes over
    assert mass_factors("heavy", k, m, 1.0)[0] == 1 / 3
    assert mass_factors("unloaded", k, m, 1.0)[0] == 4 / np.pi**2
    with pytest.raises(IdentifyError, match="too heavy for this frequency"):
        mass_factors("wave", k, m, 1.1 * w)


def test_the_packaged_bench_is_configured_with_the_truth() -> None:
    setup, swing = nominal_setup(), swing_truth().swing
    assert swing is not None
    np.testing.assert_array_equal(
        setup.stiffness_N_per_m, [s.stiffness_N_per_m for s in swing.springs]
    )
    np.testing.assert_array_equal(setup.levers_m[setup.lever], [s.lever_m for s in swing.springs])
    np.testing.assert_array_equal(setup.mass_kg, [s.mass_kg for s in swing.springs])
    assert setup.bar_inertia_kg_m2 == swing.bar_inertia_kg_m2


def test_a_bench_without_springs_is_refused() -> None:
    with pytest.raises(IdentifyError, match="no springs are described"):
        SpringSetup.of(OscillationConfig())
