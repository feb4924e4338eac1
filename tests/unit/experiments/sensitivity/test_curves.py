"""What errors of gains, offsets and cogging torque cost in ripple, against closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.config import BackEmfHarmonic, MotorConfig
from motord.experiments.sensitivity.curves import (
    RippleModel,
    gains_of,
    limit_surface,
    limits,
    offsets_of,
    single,
    volume,
)
from motord.identification import IdentifyError
from motord.identification.harmonics import harmonics_table
from motord.identification.point_ripple import rms_error_percent

TORQUE_NM = 3.0


def motor(connection: str = "independent", **changes: object) -> MotorConfig:
    third = {"star": (BackEmfHarmonic(order=3, amplitude_V_s_per_rad=0.01),)}.get(connection, ())
    first = BackEmfHarmonic(order=1, amplitude_V_s_per_rad=0.206)
    given = {
        "name": "m", "pole_pairs": 8, "slots": 48, "counts": 4096, "rated_torque_Nm": 6.0,
        "connection": connection, "back_emf": (first, *third),
    }  # fmt: skip
    return MotorConfig(**given | changes)


def model(cogging_Nm: float = 0.3) -> RippleModel:
    cogging = np.array([48]), np.array([cogging_Nm]), np.array([0.5])
    return RippleModel.of(motor(), harmonics_table(*cogging, 4096))


@pytest.mark.parametrize(("alpha_a", "percent"), [(0.8, 3.75), (1.0, 0.0), (1.2, 3.38)])
def test_a_gain_costs_what_the_sinusoidal_motor_says(alpha_a: float, percent: float) -> None:
    assert single(model(0.0), TORQUE_NM, "alpha_a", alpha_a) == pytest.approx(percent, abs=5e-3)


@pytest.mark.parametrize(("beta_a_A", "percent"), [(-1.0, 3.64), (0.0, 0.0), (1.0, 3.64)])
def test_an_offset_costs_what_the_sinusoidal_motor_says(beta_a_A: float, percent: float) -> None:
    assert single(model(), TORQUE_NM, "beta_a_A", beta_a_A) == pytest.approx(percent, abs=5e-3)


def test_one_percent_is_reached_where_the_sinusoidal_motor_says() -> None:
    low, high = limits(model(0.0), TORQUE_NM, "alpha_a")
    assert (low, high) == (pytest.approx(0.944, abs=5e-4), pytest.approx(1.057, abs=5e-4))
    low_A, high_A = limits(model(), TORQUE_NM, "beta_a_A")
    assert -low_A == pytest.approx(high_A)
    assert high_A == pytest.approx(0.27, abs=5e-3)


def test_a_factor_of_the_cogging_torque_costs_its_rms() -> None:
    expected = 100 * 0.3 * 0.25 / 2**0.5 / 6.0
    assert single(model(), TORQUE_NM, "cogging", 1.25) == pytest.approx(expected, rel=1e-6)
    low, high = limits(model(), TORQUE_NM, "cogging")
    assert high - 1 == pytest.approx(1 - low) == pytest.approx(0.25 / expected)


def test_without_cogging_torque_its_factor_costs_nothing() -> None:
    smooth = RippleModel.of(motor(), np.zeros(4096))
    assert limits(smooth, TORQUE_NM, "cogging") == (-np.inf, np.inf)
    assert limit_surface(smooth, TORQUE_NM).inside.any()


@pytest.mark.parametrize(
    "changes",
    [{}, {"counts": 1001, "pole_pairs": 5, "slots": 12}, {"connection": "star"}],
    ids=["48/16", "12/10 of odd counts", "star"],
)
@given(
    gains=st.tuples(*3 * [st.floats(0.7, 1.4)]),
    offsets_A=st.tuples(*3 * [st.floats(-1, 1)]),
    factor=st.floats(0.5, 1.5),
)
def test_the_products_give_what_the_torque_over_the_turn_gives(
    changes: dict, gains: tuple, offsets_A: tuple, factor: float
) -> None:
    of = motor(**changes)
    k, rows = of.back_emf_table(), np.arange(of.counts)
    cog_Nm = 0.3 * np.sin(2 * of.pole_pairs * 2 * np.pi * rows / of.counts)
    wanted = k - k.mean(axis=1, keepdims=True) if of.connection == "star" else k
    i_A = (TORQUE_NM - factor * cog_Nm)[:, None] * wanted / (wanted**2).sum(1, keepdims=True)
    flow_A = np.array(gains) * i_A + np.array(offsets_A)
    if of.connection == "star":  # i* + c flows as g (i* + c) + b and must sum to nothing
        flow_A -= np.array(gains) * (flow_A.sum(axis=1, keepdims=True) / sum(gains))
    expected = rms_error_percent((flow_A * k).sum(axis=1) + cog_Nm, 6.0)
    found = RippleModel.of(of, cog_Nm).rms_percent(TORQUE_NM, gains, offsets_A, factor)
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_errors_induced_in_a_star_are_taken_up_by_the_gains_of_its_sensors() -> None:
    of = motor("star")
    table = np.zeros(of.counts)
    left = RippleModel.of(of, table, share=(1.0, 1.0, 1.0)).rms_percent(3.0, gains_of(0.8))
    own = RippleModel.of(of, table).rms_percent(3.0, gains_of(0.8))
    assert 0.8 * own < left < 1.2 * own
    assert left != pytest.approx(own, rel=1e-3)


def test_the_gauge_leaves_product_and_sum_alone() -> None:
    assert gains_of(0.7).prod() == pytest.approx(1.0)
    assert offsets_of([0.3, -0.7]).sum(axis=-1) == pytest.approx(0.0)


def test_the_volume_holds_the_single_errors() -> None:
    found = volume(model(), TORQUE_NM, steps=9)
    assert found.rms_percent.shape == (9, 9, 9)
    assert found.rms_percent[4, 4, 4] == pytest.approx(0.0, abs=1e-9)
    alone = single(model(), TORQUE_NM, "beta_a_A", found.beta_a_A)
    assert found.rms_percent[4, :, 4] == pytest.approx(alone)


def test_the_surface_lies_where_the_limit_is_reached() -> None:
    found = limit_surface(model(), TORQUE_NM)
    assert not found.inside.any()
    gains, offsets = gains_of(found.alpha_a), offsets_of(found.beta_a_A)
    rms = model().rms_percent(TORQUE_NM, gains, offsets, found.cogging)
    assert rms == pytest.approx(np.ones_like(rms), rel=1e-5)
    low, high = limits(model(), TORQUE_NM, "beta_a_A")
    assert found.beta_a_A.min() == pytest.approx(low, rel=0.01)
    assert found.beta_a_A.max() == pytest.approx(high, rel=0.01)


def test_a_cogging_torque_of_another_encoder_is_refused() -> None:
    with pytest.raises(IdentifyError, match="1000 values, the motor 4096 counts"):
        RippleModel.of(motor(), np.zeros(1000))
