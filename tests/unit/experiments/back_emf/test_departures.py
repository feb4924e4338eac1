"""Back-EMF on benches that depart: intervals hold the truth, and findings name the departure."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from motord.experiments.back_emf.encoder_error import LEAST_LOST, encoder_errors, lost
from motord.experiments.back_emf.estimate import measure
from motord.experiments.back_emf.result import MeasuredBackEmf
from motord.experiments.back_emf.trends import Captures
from motord.experiments.back_emf.voltages import VOLTAGES
from motord.identification.operating_points import PointData
from motord.intervals import coverage_factor
from tests.campaigns.driven_departures import (
    DEPARTURES,
    MOTOR,
    ONE_WAY_HZ,
    TURNS,
    Bench,
    captured,
    errors_over_half_widths,
)


@pytest.mark.parametrize(
    ("name", "speeds"),
    [
        ("encoder 0.3 deg once a turn", slice(2, 4)),
        ("encoder 0.3 deg twice a turn", slice(2, 4)),
        ("magnets 0.5 % weaker at the end", slice(6)),
        ("low-pass 1 ms of the voltages", slice(6)),
    ],
)
def test_a_departure_is_named_and_in_the_interval_of_the_amplitudes(
    name: str, speeds: slice
) -> None:
    bench, finding = DEPARTURES[name]
    found = measure(captured(replace(bench, speeds_Hz=bench.speeds_Hz[speeds]), 3), MOTOR)
    assert np.abs(errors_over_half_widths(found)[:, 0]).max() < 1.0
    assert finding in {one.name for one in found.findings}


def test_an_order_of_which_an_encoder_takes_a_part_stays_in_the_table() -> None:
    bench, finding = DEPARTURES["encoder 1 deg once a turn"]
    found = measure(captured(replace(bench, speeds_Hz=bench.speeds_Hz[2:4]), 3), MOTOR)
    assert finding in {one.name for one in found.findings}
    assert {1, 3, 5, 7} <= {one.order for one in found.harmonics if one.in_table}


def test_a_phase_of_another_gain_is_named_next_to_an_encoder_that_is_off() -> None:
    bench, finding = DEPARTURES["gain of a phase 0.5 %"]
    worse = replace(bench, speeds_Hz=bench.speeds_Hz[2:4], encoder={1: np.radians(1.0)})
    assert finding in {one.name for one in measure(captured(worse, 3), MOTOR).findings}


@cache
def departed(name: str) -> MeasuredBackEmf:
    return measure(captured(DEPARTURES[name][0], 3), MOTOR)


def test_clocks_that_run_apart_are_named() -> None:
    name = "clocks 50 ppm apart"
    found, finding = departed(name), DEPARTURES[name][1]
    [one] = [one for one in found.findings if one.name == finding]
    assert one.severity == "serious"
    assert one.value == pytest.approx(50e-6 * 77e6, rel=0.1)  # 77 s between middles of captures


@pytest.mark.parametrize("name", [name for name in DEPARTURES if name.startswith("clocks")])
def test_phases_and_age_hold_clocks_that_run_apart(name: str) -> None:
    bench, found = DEPARTURES[name][0], departed(name)
    assert np.abs(errors_over_half_widths(found)[:, 1]).max() < 1.0
    assert found.age is not None
    # clocks are alike as the first capture begins
    first_s = bench.clock * (TURNS + 0.5) / abs(bench.speeds_Hz[0]) / 2
    half_width_s = coverage_factor(found.age.freedom) * found.age.stderr_s
    assert abs(found.age.age_s - first_s) < half_width_s


def test_what_clocks_may_make_of_phases_narrows_no_interval() -> None:
    found = measure(captured(Bench(speeds_Hz=ONE_WAY_HZ), 1), MOTOR)
    alike = replace(found, trends=())
    for one, other in zip(found.harmonics, alike.harmonics, strict=True):
        half, least = (
            coverage_factor(each.phase_degrees_of_freedom) * each.phase_stderr_rad
            for each in (one, other)
        )
        assert half > least or one.phase_stderr_rad == np.pi


def with_old_voltages(point: PointData, late: int = 5) -> PointData:
    """Return a capture whose voltages are older by so many samples than it says."""
    ticks = point.ticks[late:].copy()
    for name in VOLTAGES:
        ticks[name] = point.ticks[name][:-late]
    return replace(point, ticks=ticks)


@pytest.mark.parametrize(
    ("speeds", "severity"), [(2, "serious"), (3, "serious"), (4, "serious"), (5, "warning")]
)
def test_an_age_that_clocks_may_explain_is_serious(speeds: int, severity: str) -> None:
    bench = Bench(speeds_Hz=(0.53, 0.87, 1.37, 0.7, 1.1)[:speeds])
    found = measure([with_old_voltages(one) for one in captured(bench, 3)], MOTOR)
    [age] = [one for one in found.findings if one.name == "age-of-voltages"]
    assert age.severity == severity


def sidebands(x: float, sign: int, order: int = 1) -> np.ndarray:
    """Return a spectrum of three phases whose fundamental of order 8 has sidebands of x / 2."""
    rng = np.random.default_rng(1)
    lines = 1e-6 * (rng.standard_normal((3, 64)) + 1j * rng.standard_normal((3, 64)))
    lines[:, 8 + order - 1] = -x / 2 * np.exp(0.7j) * (8 + order) / 8
    lines[:, 8 - order - 1] = sign * x / 2 * np.exp(-0.7j) * (8 - order) / 8
    return lines


@pytest.mark.parametrize("order", [1, 2])
def test_sidebands_of_opposite_signs_are_the_encoder_s(order: int) -> None:
    once = encoder_errors(np.ones(3, complex), sidebands(0.04, 1, order), 8)
    assert [one.significant for one in once] == [order == 1, order == 2]
    assert once[order - 1].error_rad == pytest.approx(0.04 / 8, rel=1e-3)
    assert lost(once, np.array([8, 24])) == pytest.approx([0.04**2 / 4, 0.12**2 / 4], rel=0.01)
    unequal_magnets = encoder_errors(np.ones(3, complex), sidebands(0.04, -1, order), 8)
    assert not any(one.significant for one in unequal_magnets)
    assert lost(unequal_magnets, np.array([8])) == 0.0


def test_what_takes_nothing_off_is_no_error_of_the_encoder() -> None:
    limit = 2 * np.sqrt(LEAST_LOST)
    for x, there in ((0.95 * limit, False), (1.05 * limit, True)):
        found = encoder_errors(np.ones(3, complex), sidebands(x, 1), 8)
        assert found[0].significant == there
    assert encoder_errors(np.ones(3, complex), sidebands(0.04, 1), 2) == ()


def captures(
    rng: np.random.Generator, common: float, *, more: np.ndarray | float = 0.0
) -> Captures:
    """Return six captures of two orders: noise of 1e-4 and 1e-3, and one that orders share."""
    velocity_rad_s = 2 * np.pi * np.array([0.53, 0.87, 1.37, -1.37, -0.87, -0.53])
    stderr = np.tile([1e-4, 1e-3], (6, 1))
    noise = stderr * rng.standard_normal((6, 2)) + common * rng.standard_normal((6, 1))
    return Captures(
        np.array([8, 24]), noise + more, noise / [8, 24], stderr**2, np.full((6, 2), 1 / 6),
        np.arange(6.0), velocity_rad_s,
    )  # fmt: skip


@pytest.mark.parametrize("common", [0.0, 1e-3])
def test_trends_by_chance_are_as_rare_as_stated(common: float) -> None:
    rng, trials = np.random.default_rng(8), 400
    found = [list(captures(rng, common).trends()) for _ in range(trials)]
    for place in range(3):
        kind = [one[place] for one in found]
        assert np.mean([one.widens for one in kind]) < 0.05 + 0.025
        assert sum(one.significant for one in kind) <= 3


def test_a_trend_is_what_the_mean_is_off_by() -> None:
    rng = np.random.default_rng(3)
    fallen = -0.01 * np.arange(6.0)[:, None] / 5
    frequency, time, clock = captures(rng, 0.0, more=fallen).trends()
    assert time.significant
    assert time.part == pytest.approx(0.005, rel=0.05)
    assert not frequency.widens
    assert not clock.widens
    risen = {one.kind: one for one in captures(rng, 0.0, more=-fallen).trends()}
    assert risen["time"].part == pytest.approx(-0.005, rel=0.05)
    omega = 2 * np.pi * np.array([0.53, 0.87, 1.37, 1.37, 0.87, 0.53])[:, None] * [8, 24]
    for tau_s, possible in ((1e-3, 1.0), (1e-3, -1.0)):
        shown = next(captures(rng, 0.0, more=-possible * (omega * tau_s) ** 2 / 2).trends())
        assert shown.significant == (possible > 0)
        assert shown.slope == pytest.approx(possible * tau_s**2, rel=0.1)
