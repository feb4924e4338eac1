"""The bar between springs: energy, period and stiffness against closed forms; the deflection."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from motord.config import packaged
from motord.rig.build import build
from motord.rig.free_decay import inertia_with_springs, spring_torque_Nm
from motord.rig.truth import RigTruth, load
from motord.rig.truth.swing import SpringTruth
from tests.unit.rig.probe import PLAIN, Probe, plain

PAIR = [
    {"stiffness_N_per_m": 100.0, "lever_m": 0.5, "mass_kg": 0.0, "side": side} for side in (1, -1)
]
SWING = {"bar_inertia_kg_m2": 0.0095, "springs": PAIR, "deflection_spread": 0.0}


def barred(**changes: object) -> RigTruth:
    return RigTruth.model_validate({**PLAIN, "swing": {**SWING, **changes}})


@pytest.mark.kernel
def test_small_angles_meet_the_sum_of_stiffness_lever_squared() -> None:
    parameters, _ = build(barred(rest_angle_rad=1.0), 1)
    torque_Nm = [spring_torque_Nm(parameters[0], 1.0 + x) for x in (-1e-4, 0.0, 1e-4)]
    np.testing.assert_allclose(torque_Nm, [50e-4, 0.0, -50e-4], atol=1e-9)


@pytest.mark.kernel
def test_the_torque_is_what_the_energy_falls_by() -> None:
    parameters, _ = build(barred(length_m=0.6, stretch_m=0.2), 1)

    def energy_J(x: float) -> float:
        total = 0.0
        for side in (1, -1):
            end = 0.5 * np.array([np.cos(x), np.sin(x)])
            stretched_m = np.hypot(*(np.array([0.5, side * 0.6]) - end)) - 0.4
            total += 50.0 * stretched_m**2
        return total

    for x in (-0.3, 0.05, 0.17, 0.3):
        slope = (energy_J(x + 1e-5) - energy_J(x - 1e-5)) / 2e-5
        assert spring_torque_Nm(parameters[0], x) == pytest.approx(-slope, rel=1e-6)


@pytest.mark.kernel
def test_the_hand_rests_pulls_holds_and_lets_go() -> None:
    probe = Probe(barred(first_s=0.1, pull_s=0.1, hold_s=0.1, swing_s=0.2, rest_angle_rad=2.0))
    time_s, _, truths = probe.trace(122, every=50)
    deflected_rad = truths["angle_rad"] - 2.0
    assert (deflected_rad[time_s < 0.1] == 0).all()
    held = (time_s > 0.2) & (time_s < 0.3)
    np.testing.assert_allclose(deflected_rad[held], 0.17)
    assert (truths["speed_rad_s"][held] == 0).all()
    free = deflected_rad[(time_s > 0.301) & (time_s < 0.499)]
    assert free.min() == pytest.approx(-0.17, rel=0.01)  # no friction
    assert (np.abs(free) <= 0.17 * (1 + 1e-6)).all()
    assert deflected_rad[-1] == pytest.approx(0.17)  # pulled again at 0.5 s, held from 0.6 s on


def test_it_swings_as_solve_ivp_says() -> None:
    truth = barred(first_s=0.01, pull_s=0.01, hold_s=0.01, swing_s=100.0)
    probe = Probe(truth).advance(0.015)
    while probe.state[0].hand:
        probe.advance(probe.substep_s)
    time_s, _, truths = probe.trace(800, every=10)

    def slope(_: float, x: np.ndarray) -> list[float]:
        return [x[1], spring_torque_Nm(probe.parameters[0], x[0]) / 0.02]

    ends = (0.0, float(time_s[-1]))
    expected = solve_ivp(slope, ends, [0.17, 0.0], t_eval=time_s, rtol=1e-10, atol=1e-12).y[0]
    np.testing.assert_allclose(truths["angle_rad"], expected, atol=3e-4)


def test_the_deflection_varies_from_release_to_release() -> None:
    probe = Probe(barred(deflection_spread=0.1, first_s=0.0, pull_s=0.01, hold_s=0.01, swing_s=0.1))
    _, _, truths = probe.trace(1200, every=10)
    held = np.unique(truths["angle_rad"][truths["speed_rad_s"] == 0].round(9))
    assert held[held > 0.05].size >= 8
    assert 0.004 < held[held > 0.05].std() < 0.04


@given(mass_kg=st.floats(1e-4, 0.3), stiffness=st.floats(10.0, 300.0), rigid=st.floats(1e-3, 0.1))
def test_effective_mass_lies_between_its_two_limits(
    mass_kg: float, stiffness: float, rigid: float
) -> None:
    spring = SpringTruth(stiffness_N_per_m=stiffness, lever_m=0.4, mass_kg=mass_kg, side=1)
    factor = (inertia_with_springs(rigid, (spring,)) - rigid) / (mass_kg * 0.16)
    assert 1 / 3 - 1e-6 <= factor <= 4 / np.pi**2 + 1e-6


def test_effective_mass_in_the_limits() -> None:
    spring = SpringTruth(stiffness_N_per_m=100.0, lever_m=0.5, mass_kg=0.02, side=1)
    heavy = (inertia_with_springs(10.0, (spring,)) - 10.0) / (0.02 * 0.25)
    light = (inertia_with_springs(1e-9, (spring,)) - 1e-9) / (0.02 * 0.25)
    assert heavy == pytest.approx(1 / 3, rel=1e-3)
    assert light == pytest.approx(4 / np.pi**2, rel=1e-3)
    massless = spring.model_copy(update={"mass_kg": 0.0})
    assert inertia_with_springs(0.02, (massless,)) == 0.02


def test_packaged_set_up_swings_like_the_reports() -> None:
    truth = load(packaged("inertia.rig.toml"))
    assert truth.swing is not None
    probe = Probe(truth)
    stiffness_Nm = sum(s.stiffness_N_per_m * s.lever_m**2 for s in truth.swing.springs)
    period_s = 2 * np.pi * np.sqrt(probe.parameters[0].inertia_kg_m2 / stiffness_Nm)
    assert 0.12 < period_s < 0.15  # five of them in about 0.7 s: Figure 2.4


def test_a_rig_without_a_bar_has_no_hand() -> None:
    probe = Probe(plain())
    probe.trace(100)
    assert probe.state[0].hand_s == 0.0
    assert probe.state[0].hand == 0


def test_slack_springs_are_refused() -> None:
    with pytest.raises(ValueError, match="the springs go slack"):
        barred(stretch_m=0.05)
    with pytest.raises(ValueError, match="stretch_m must be below length_m"):
        barred(stretch_m=0.7)
