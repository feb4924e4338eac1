"""The table of RMS errors: each figure with its 95 % interval, as far as it is known."""

import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from motord.calibration import RmsErrors
from motord.experiments.ripple.estimate import MeshRipple
from motord.experiments.ripple.report import fill, fill_key_figures
from motord.identification.operating_points import prepare
from motord.identification.point_ripple import (
    PointRipple,
    point_ripple,
    rms_errors,
)
from motord.report.html import Page
from motord.report.text import TextTable, error_table, largest_interval
from tests.unit.identification.synthetic_bench import Bench


@pytest.fixture(scope="module")
def ripple() -> PointRipple:
    bench = Bench()
    samples = prepare(bench.point(torque_Nm=2.0, speed_Hz=0.6, turns=3, seed=1), bench.motor.counts)
    found = point_ripple(samples, bench.motor, bench.sensor)
    return replace(found, compensate=0, rms_percent=6.0, stderr_percent=0.1)


def shown(*ripples: PointRipple) -> tuple[list[tuple[str, ...]], list[str]]:
    table, *lines = error_table(rms_errors(ripples))
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
        ("4", "0.6", "5.00 (interval not known)", ""),
    ]
    assert lines == [
        "before: mean 5.50 % (interval not known), worst 6.00 % (interval not known)",
        "after: mean 0.200 +- 0.020 %, worst 0.200 +- 0.020 %",
    ]


def test_the_worst_may_be_another_point_than_the_one_that_shows_most(ripple: PointRipple) -> None:
    noisy = replace(ripple, torque_Nm=4.0, rms_percent=5.9, stderr_percent=0.5)
    rows, [line] = shown(ripple, noisy)
    assert rows == [("2", "0.6", "6.00 +- 0.20"), ("4", "0.6", "5.90 +- 0.98")]
    assert line == "before: mean 5.95 +- 0.59 %, worst 6.0 +- 1.0 %"


def cards(found: MeshRipple) -> list[tuple[str, str]]:
    page = Page("")
    fill_key_figures(page, found.errors)
    return re.findall(r"<b>([^<]*)</b><span>([^<]*)<", page.html())


def test_a_page_states_the_intervals_that_the_table_states(ripple: PointRipple) -> None:
    other = replace(ripple, torque_Nm=4.0, rms_percent=8.0, stderr_percent=0.3)
    found = MeshRipple((ripple, other), scale=0.01)
    _, line = error_table(found.errors)
    assert line == "before: mean 7.00 +- 0.42 %, worst 8.00 +- 0.70 %"
    assert cards(found) == [
        ("7.00\u00a0\u00b1\u00a00.42 %", "mean RMS error without compensation, 95 %"),
        ("8.00\u00a0\u00b1\u00a00.70 %", "the largest without compensation, at 4 Nm, 0.6 Hz, 95 %"),
    ]
    single_turn = replace(other, stderr_percent=None)
    unknown = [figure for figure, _ in cards(MeshRipple((ripple, single_turn)))]
    assert unknown == ["7.00 % (interval not known)", "8.00 % (interval not known)"]


def test_a_file_of_rms_errors_keeps_the_intervals_and_is_as_before_without(
    ripple: PointRipple,
) -> None:
    errors = rms_errors([ripple])
    assert RmsErrors.model_validate_json(errors.model_dump_json()) == errors
    content = rms_errors([replace(ripple, stderr_percent=None)]).model_dump(mode="json")
    assert content["before"] == {"mean": 6.0, "max": 6.0}
    assert list(content["points"][0]) == ["torque_Nm", "speed_Hz", "before", "after"]


def test_the_scale_of_the_torque_widens_the_interval(ripple: PointRipple) -> None:
    unchanged = ripple.with_scale_error(0.0)
    for field in fields(ripple):
        np.testing.assert_equal(getattr(unchanged, field.name), getattr(ripple, field.name))
    widened = ripple.with_scale_error(0.04)
    assert widened.stderr_percent == pytest.approx(0.26)
    unknown = replace(ripple, stderr_percent=None)
    assert unknown.with_scale_error(0.04).stderr_percent is None


@pytest.mark.parametrize(
    ("half_widths", "sentence"),
    [
        ((0.0123, 0.4), "95 % intervals are +-0.40 % at most."),
        ((0.0123, None), "95 % intervals are +-0.012 % at most, where they are known."),
        ((None,), "95 % intervals are not known."),
        ((), "95 % intervals are not known."),
    ],
)
def test_the_largest_interval_is_a_sentence(
    half_widths: tuple[float | None, ...], sentence: str
) -> None:
    assert largest_interval(half_widths) == sentence


@pytest.mark.usefixtures("no_pictures")
def test_a_heat_map_says_how_well_its_figures_are_known(
    ripple: PointRipple, tmp_path: Path
) -> None:
    page = Page("Verification", "a motor")
    fill(page, [ripple], Bench().motor)
    page.write(tmp_path / "r.html")
    assert re.search(r"95 % intervals are \S0\.20 % at most", (tmp_path / "r.html").read_text())
