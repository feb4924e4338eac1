"""Limits from moving ranges, and the Western Electric rules, point by point."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.results.control_chart import RULES, control_chart, trends, violations
from tests.unit.results.made_up import row

HIGH = [2.1, 2.1]
ZONES = st.lists(st.sampled_from([-3.5, -2.5, -1.5, -0.5, 0.0, 0.5, 1.5, 2.5, 3.5]), max_size=20)


def test_sigma_is_the_mean_moving_range_over_d2():
    chart = control_chart(np.array([1.0, 3.0, 2.0, 2.0]))
    assert chart.centre == 2.0
    assert chart.sigma == pytest.approx((2 + 1 + 0) / 3 / 1.128)
    assert chart.limits == pytest.approx((2 - 3 * chart.sigma, 2 + 3 * chart.sigma))


def test_sigma_is_that_of_normal_values_whatever_the_drift():
    values = np.random.default_rng(3).normal(5.0, 2.0, 20_000)
    assert control_chart(values).sigma == pytest.approx(2.0, rel=0.03)
    drifting = values + np.linspace(0, 100, values.size)
    assert control_chart(drifting).sigma == pytest.approx(2.0, rel=0.03)


@pytest.mark.parametrize(
    ("sigmas", "expected"),
    [
        ([0, 3.1, 0], [(), (1,), ()]),
        ([0, 3.0, 0], [(), (), ()]),
        ([0, -3.1, 0], [(), (1,), ()]),
        ([2.1, 0, 2.1], [(), (), (2,)]),
        ([2.1, 2.1, 0], [(), (2,), ()]),
        ([2.1, 0, 0, 2.1], [(), (), (), ()]),
        ([2.1, -2.1, 0], [(), (), ()]),
        ([2.0, 2.0, 2.0], [(), (), ()]),
        ([1.1, 1.1, 0, 1.1, 1.1], [(), (), (), (), (3,)]),
        ([1.1, 1.1, 1.1, 1.1, -0.1], [(), (), (), (3,), ()]),
        ([1.1, 1.1, 0, 0, 1.1, 1.1], [()] * 6),
        ([1.1, 1.1, -1.1, -1.1, 1.1], [()] * 5),
        ([-0.1] * 8, [()] * 7 + [(4,)]),
        ([-0.1] * 7 + [0.0] + [-0.1] * 7, [()] * 15),
        ([-0.1] * 10, [()] * 7 + [(4,)] * 3),
        ([3.1, 3.1], [(1,), (1, 2)]),
    ],
)
def test_rules(sigmas, expected):
    assert list(violations(np.array(sigmas) * 0.5 + 7.0, 7.0, 0.5)) == expected


@given(ZONES)
def test_rules_are_those_of_their_definition(sigmas):
    for at, found in enumerate(violations(np.array(sigmas), 0.0, 1.0)):
        for rule in RULES:
            window = sigmas[max(at + 1 - rule.window, 0) : at + 1]
            sides = [
                sum(side * x > rule.sigmas for x in window) >= rule.count
                and side * sigmas[at] > rule.sigmas
                for side in (1, -1)
            ]
            assert (rule.number in found) == any(sides)


@given(ZONES)
def test_a_mirrored_chart_has_the_same_violations(sigmas):
    values = np.array(sigmas)
    assert violations(values, 0.0, 1.0) == violations(-values, 0.0, 1.0)


def test_false_alarms_are_as_rare_as_the_rules_promise():
    """About one point in a hundred, of all four rules (Champ and Woodall 1987: run length 92)."""
    values = np.random.default_rng(7).normal(size=50_000)
    found = violations(values, 0.0, 1.0)
    assert np.mean([1 in rules for rules in found]) == pytest.approx(0.0027, rel=0.2)
    assert 1 / 92 < np.mean([bool(rules) for rules in found]) < 3 / 92


@given(st.floats(-1e9, 1e9), st.integers(2, 60))
def test_constant_values_violate_nothing(value, count):
    chart = control_chart(np.full(count, value))
    assert chart.sigma == 0.0
    assert chart.limits == pytest.approx((value, value))
    assert not any(chart.violated)


@pytest.mark.parametrize(("count", "preliminary"), [(2, True), (19, True), (20, False)])
def test_few_points_give_preliminary_limits(count, preliminary):
    assert control_chart(np.arange(float(count))).preliminary == preliminary


def test_one_value_has_no_chart():
    with pytest.raises(ValueError, match="two points"):
        control_chart(np.ones(1))
    [alone] = trends([row()], "serial")
    assert alone.chart is None
    assert alone.violated == [()]


def test_each_serial_has_a_chart_of_its_own():
    rows = [row(value, serial=serial) for serial in ("B", "A") for value in (1.0, 2.0)]
    found = trends(rows, "serial")
    assert [(one.name, one.values.tolist()) for one in found] == [("A", [1, 2]), ("B", [1, 2])]
    assert [one.name for one in trends(rows, "bench")] == ["north"]


def test_phases_are_charted_without_whole_turns():
    rows = [row(v, field="h.16.phase_rad", unit="rad") for v in (3.1, -3.1, 3.0)]
    [one] = trends(rows, "serial")
    assert one.values == pytest.approx([3.1, 2 * np.pi - 3.1, 3.0])


def test_errors_are_the_distances_to_the_ends_of_the_interval():
    rows = [row(1.0, low=0.5, high=1.25, stderr=0.3), row(1.0, low=None, high=None, stderr=None)]
    [one] = trends(rows, "serial")
    np.testing.assert_array_equal(one.errors, [[0.5, np.nan], [0.25, np.nan]])
    assert one.stderr == 0.3


def test_results_that_resemble_those_before_are_said_to_and_others_are_not():
    independent = correlated = 0
    for seed in range(200):
        values = np.random.default_rng(seed).normal(size=50)
        independent += control_chart(values).correlated
        for place in range(1, 50):
            values[place] = 0.5 * values[place - 1] + np.sqrt(0.75) * values[place]
        correlated += control_chart(values).correlated
    assert independent <= 10
    assert correlated >= 160
    assert not control_chart(np.array([3.0, 3.0, 3.0])).correlated
