"""The table of RMS errors: each figure with its 95 % interval, as far as it is known."""

from dataclasses import replace

import pytest

from motord.experiments.ripple.estimate import MeshRipple
from motord.experiments.ripple.report import worst_figure
from motord.identification.operating_points import prepare
from motord.identification.point_ripple import (
    PointRipple,
    point_ripple,
    rms_errors,
    rms_half_widths,
)
from motord.report.text import TextTable, error_table
from tests.unit.identification.synthetic_bench import Bench


@pytest.fixture(scope="module")
def ripple() -> PointRipple:
    bench = Bench()
    samples = prepare(bench.point(torque_Nm=2.0, speed_Hz=0.6, turns=3, seed=1), bench.motor.counts)
    found = point_ripple(samples, bench.motor, bench.sensor)
    return replace(found, compensate=0, rms_percent=6.0, stderr_percent=0.1)


def shown(*ripples: PointRipple) -> tuple[list[tuple[str, ...]], list[str]]:
    table, *lines = error_table(rms_errors(ripples), rms_half_widths(ripples))
    assert isinstance(table, TextTable)
    return [tuple(row) for row in table.rows], [str(line) for line in lines]


def test_figures_have_intervals_and_a_mean_the_mean_of_them(ripple: PointRipple) -> None:
    other = replace(ripple, torque_Nm=4.0, rms_percent=8.0, stderr_percent=0.3)
    rows, lines = shown(ripple, other)
    assert rows == [("2", "0.6", "6.00 +- 0.20"), ("4", "0.6", "8.00 +- 0.59")]
    assert lines == ["before: mean 7.00 +- 0.39 %, worst 8.00 +- 0.67 %"]


def test_takes_of_one_set_point_are_no_more_certain_together(ripple: PointRipple) -> None:
    rows, _ = shown(ripple, replace(ripple, rms_percent=7.0))
    assert rows == [("2", "0.6", "6.50 +- 0.20")]


def test_what_is_not_known_is_not_stated(ripple: PointRipple) -> None:
    single_turn = replace(ripple, torque_Nm=4.0, rms_percent=5.0, stderr_percent=None)
    after = replace(ripple, compensate=7, rms_percent=0.2, stderr_percent=0.01)
    rows, lines = shown(ripple, single_turn, after)
    assert rows == [
        ("2", "0.6", "6.00 +- 0.20", "0.200 +- 0.020"),
        ("4", "0.6", "5.00", ""),
    ]
    assert lines == [
        "before: mean 5.50 %, worst 6.00 %",
        "after: mean 0.200 +- 0.020 %, worst 0.200 +- 0.020 %",
    ]


def test_the_worst_may_be_another_point_than_the_one_that_shows_most(ripple: PointRipple) -> None:
    noisy = replace(ripple, torque_Nm=4.0, rms_percent=5.9, stderr_percent=0.5)
    rows, [line] = shown(ripple, noisy)
    assert rows == [("2", "0.6", "6.00 +- 0.20"), ("4", "0.6", "5.90 +- 0.98")]
    assert line == "before: mean 5.95 +- 0.59 %, worst 6.0 +- 1.0 %"


def test_a_page_states_the_interval_of_the_worst_that_the_table_states(ripple: PointRipple) -> None:
    other = replace(ripple, torque_Nm=4.0, rms_percent=8.0, stderr_percent=0.3)
    found = MeshRipple((ripple, other), scale=0.01)
    _, line = error_table(found.errors, found.half_widths)
    assert str(line).endswith("worst 8.00 +- 0.70 %")
    assert worst_figure(found) == ("8.00 +- 0.70 %", "the largest, at 4 Nm, 0.6 Hz, 95 %")
    single_turn = replace(other, stderr_percent=None)
    assert worst_figure(MeshRipple((ripple, single_turn))) == (
        "8.00 %", "the largest, at 4 Nm, 0.6 Hz",
    )  # fmt: skip


def test_the_scale_of_the_torque_widens_the_interval(ripple: PointRipple) -> None:
    assert ripple.with_scale_error(0.0) == ripple
    widened = ripple.with_scale_error(0.04)
    assert widened.stderr_percent == pytest.approx(0.26)
    unknown = replace(ripple, stderr_percent=None)
    assert unknown.with_scale_error(0.04).stderr_percent is None
