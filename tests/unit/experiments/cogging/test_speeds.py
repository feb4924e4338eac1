"""What speeds show by their differences: an age of the torque, an angle that slips, gains."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from motord.experiments.cogging.estimate import average, measure
from motord.findings import Finding
from motord.identification.operating_points import PointData
from motord.intervals import t_quantile
from tests.campaigns.cogging_speeds import MAIN, MOTOR, Speeds, coverage, drawn
from tests.campaigns.departures import torque_late
from tests.campaigns.driven import REPORT, bench_of, ticks_of

NAMES = {"torque-age", "angle-slips", "speeds-differ"}
SPEEDS_HZ = (0.5, 0.7, 0.9)


@cache
def recorded(seed: int) -> tuple[PointData, ...]:
    return tuple(ticks_of("cogging", REPORT, seed, speeds_Hz=SPEEDS_HZ, turns=8)[2])


def found(points: tuple[PointData, ...]) -> dict[str, Finding]:
    config = bench_of(REPORT)[0]
    findings = measure(points, config.motor, config.torque_sensor).findings
    return {one.name: one for one in findings if one.name in NAMES}


def late(_: int, ticks: np.ndarray) -> np.ndarray:
    return torque_late(1e-3, 1.0, ticks)


def slipped(number: int, ticks: np.ndarray) -> np.ndarray:
    moved = ticks.copy()
    if number == 1:
        moved["encoder_count"] = (ticks["encoder_count"] + 4) % REPORT.counts
    return moved


def warmer(number: int, ticks: np.ndarray) -> np.ndarray:
    scaled = ticks.copy()
    scaled["torque_Nm"] *= 1 + 0.02 * number
    return scaled


@pytest.mark.parametrize(
    ("departs", "name", "value"),
    [(late, "torque-age", 1000.0), (slipped, "angle-slips", 2.7), (warmer, "speeds-differ", 2.0)],
)
def test_what_departs_between_speeds_is_named(
    departs: Callable[[int, np.ndarray], np.ndarray], name: str, value: float
) -> None:
    points = (
        replace(one, ticks=departs(number, one.ticks)) for number, one in enumerate(recorded(1))
    )
    findings = found(tuple(points))
    assert list(findings) == [name]
    assert findings[name].value == pytest.approx(value, rel=0.3)  # against the weighted mean


@pytest.mark.parametrize("seed", [1, 2])
def test_speeds_of_a_sound_bench_do_not_differ(seed: int) -> None:
    assert not found(recorded(seed))


def test_gains_that_differ_between_speeds_are_in_the_intervals_of_amplitudes() -> None:
    """2 % from speed to speed: their mean is not known better than by how they differ."""
    config = bench_of(REPORT)[0]
    scaled = (
        replace(one, ticks=warmer(number, one.ticks)) for number, one in enumerate(recorded(1))
    )
    plain, apart = (
        measure(points, config.motor, config.torque_sensor) for points in (recorded(1), scaled)
    )
    strong = plain.amplitude_Nm > 20 * plain.stderr_Nm
    assert strong.any()
    assert (np.abs(apart.amplitude_Nm - plain.amplitude_Nm) < apart.half_width_Nm)[strong].all()
    assert (apart.half_width_Nm > 0.04 * apart.amplitude_Nm)[strong].all()  # t of 2: 4.3
    for place in np.flatnonzero(strong):
        one = apart.harmonics[place]
        assert one.half_width_Nm == apart.half_width_Nm[place]
        assert one.stderr_Nm > 0.01 * one.amplitude_Nm
        assert one.phase_half_width_rad < 0.5 * one.half_width_Nm / one.amplitude_Nm
    whole_Nm, half_Nm = apart.peak_to_peak_Nm
    assert half_Nm > 0.04 * whole_Nm
    assert abs(whole_Nm - plain.peak_to_peak_Nm[0]) < half_Nm


def test_gains_that_differ_are_in_the_intervals_once() -> None:
    """3 % from speed to speed, noise a tenth of that: Student's t of their own scatter."""
    lines = drawn(Speeds(6, 1, gain=0.03), np.random.default_rng(1))
    found = average(lines, MOTOR)
    sizes_Nm = [abs(one.line_Nm[MAIN]) for one in lines]
    by_scatter_Nm = t_quantile(0.975, 5) * np.std(sizes_Nm, ddof=1) / 6**0.5
    assert found.half_width_Nm[MAIN] == pytest.approx(by_scatter_Nm, rel=0.03)


def test_intervals_hold_where_gains_differ() -> None:
    assert coverage(Speeds(6, 1, gain=0.01), draws=40, seed=1)[0] >= 0.9


def test_what_an_order_differs_by_alone_is_in_its_interval() -> None:
    lines = drawn(Speeds(6, 1, gain=0.0), np.random.default_rng(1))
    place = 0  # order 16
    plain = average(lines, MOTOR).half_width_Nm
    lines[0].line_Nm[place] += 3e-3
    apart = average(lines, MOTOR).half_width_Nm
    assert apart[place] > 4 * plain[place]


def test_a_cogging_torque_beyond_the_rated_torque_is_in_another_unit() -> None:
    config = bench_of(REPORT)[0]
    in_mNm = [replace(one, ticks=one.ticks.copy()) for one in recorded(1)]
    for one in in_mNm:
        one.ticks["torque_Nm"] *= 1000
    for points, seen in ((recorded(1), False), (in_mNm, True)):
        names = {f.name for f in measure(points, config.motor, config.torque_sensor).findings}
        assert ("torque-scale" in names) == seen


def test_the_table_keeps_its_digits_of_a_motor_of_a_millinewton_metre() -> None:
    config = bench_of(REPORT)[0]
    points = []
    for one in recorded(1):
        ticks = one.ticks.copy()
        ticks["torque_Nm"] *= 2.0**-13
        points.append(replace(one, ticks=ticks))
    small = measure(points, config.motor, config.torque_sensor)
    apart_Nm = np.abs(small.rounded_tau_cog_Nm - small.tau_cog_Nm).max()
    assert apart_Nm < 1e-8 * np.abs(small.tau_cog_Nm).max()
