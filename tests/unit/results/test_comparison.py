"""Differences with combined uncertainty, and how often chance makes one count."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import ttest_ind

from motord.intervals import coverage_factor
from motord.results.comparison import compare, mean_of
from motord.results.figures import ResultFigure

KEY = ("calibrate", "alpha.a", "")


def measured(value, stderr, freedom=None, field="alpha.a", unit=""):
    half = coverage_factor(freedom) * stderr
    return ResultFigure(field, unit, value, stderr, value - half, value + half)


def only(a, b, key=KEY):
    [one] = compare({key: a}, {key: b})
    return one


def test_uncertainties_combine_by_the_root_of_their_squares():
    one = only([measured(1.0, 0.3)], [measured(2.0, 0.4)])
    assert one.difference == 1.0
    assert one.half_width == pytest.approx(1.959964 * 0.5, rel=1e-4)
    assert one.p_value == pytest.approx(0.0455, rel=1e-3)
    assert one.changed
    assert not only([measured(1.0, 0.3)], [measured(1.97, 0.4)]).changed


def test_few_degrees_of_freedom_widen_the_interval():
    """Two samples of four: what is stated of their means is compared as Welch's test does."""
    rng = np.random.default_rng(1)
    a, b = rng.normal(0, 1, 4), rng.normal(2, 3, 4)
    of_a, of_b = (measured(x.mean(), x.std(ddof=1) / 2, 3) for x in (a, b))
    expected = ttest_ind(b, a, equal_var=False)
    one = only([of_a], [of_b])
    assert one.p_value == pytest.approx(expected.pvalue, rel=1e-6)
    low, high = expected.confidence_interval()
    assert (one.difference - one.half_width, one.difference + one.half_width) == pytest.approx(
        (low, high), rel=1e-6
    )


def test_several_results_are_averaged_and_their_scatter_counts():
    found = mean_of([measured(1.0, 0.01), measured(2.0, 0.01), measured(3.0, 0.01)])
    assert (found.value, found.results, found.freedom) == (2.0, 3, 2)
    assert found.uncertainty == pytest.approx(1 / np.sqrt(3))
    close = mean_of([measured(2.0, 0.3), measured(2.001, 0.4)])
    assert close.uncertainty == pytest.approx(0.25 * np.sqrt(2))


def test_results_without_an_error_are_taken_to_be_like_the_others():
    found = mean_of([measured(1.0, 0.3, 5), ResultFigure("alpha.a", "", 1.0)])
    assert found.uncertainty == pytest.approx(0.3)
    assert found.freedom == pytest.approx(5)


def test_an_interval_alone_gives_the_uncertainty():
    found = mean_of([ResultFigure("coulomb_Nm", "Nm", 3.0, None, 2.0, 4.0)])
    assert found.uncertainty == pytest.approx(1 / 1.959964, rel=1e-5)


def test_an_interval_around_no_error_counts_as_if_it_were_alone():
    alone, around = (ResultFigure("alpha.a", "", 1.0, error, 0.8, 1.2) for error in (None, 0.0))
    assert mean_of([around]) == mean_of([alone])


def test_an_interval_alone_may_be_of_few_repetitions():
    """As stored results of friction have it, from before: each of them of three coast-downs."""
    rng = np.random.default_rng(3)
    alarms = 0
    for _ in range(100):
        a, b = (
            {
                ("friction", f"x{n}", "Nm"): [
                    ResultFigure(f"x{n}", "Nm", value, None, value - half, value + half)
                ]
                for n, (value, half) in enumerate(zip(values, halves, strict=True))
            }
            for values, halves in zip(
                rng.normal(size=(2, 400)),
                coverage_factor(2) * np.sqrt(rng.chisquare(2, (2, 400)) / 2),
                strict=True,
            )
        )
        alarms += any(one.changed for one in compare(a, b))
    assert alarms <= 5  # 5 %


SHARES_IN_COMMON = (0.0, 0.5, 1.0)
"""Of the stated variance, what all results of a side have in common: nothing, half, all."""


def alarms(rng, number, in_common, trials=600, change=0.0, unstated=0.0):
    """Return the share of comparisons of so many results a side, u = 1, that say `changed`."""
    found = 0
    for _ in range(trials):
        a, b = (
            rng.normal(mean, in_common**0.5)
            + rng.normal(0, (1 - in_common + unstated) ** 0.5, number)
            for mean in (0.0, change)
        )
        found += only([measured(x, 1.0) for x in a], [measured(x, 1.0) for x in b]).changed
    return found / trials


@pytest.mark.parametrize("in_common", SHARES_IN_COMMON)
@pytest.mark.parametrize("number", [1, 4, 16])
def test_an_error_that_results_have_in_common_does_not_average_out(number, in_common):
    assert alarms(np.random.default_rng(7), number, in_common) <= 0.075


@pytest.mark.parametrize("in_common", SHARES_IN_COMMON)
@pytest.mark.parametrize("number", [1, 4, 16])
def test_a_change_of_several_uncertainties_is_found(number, in_common):
    assert alarms(np.random.default_rng(8), number, in_common, 200, change=6.0) >= 0.95


def test_results_that_scatter_more_than_they_state_are_averaged():
    rng = np.random.default_rng(9)
    assert alarms(rng, 16, 0.0, 600, unstated=99.0) <= 0.075
    assert alarms(rng, 16, 0.0, 100, unstated=99.0, change=15.0) >= 0.95


def test_without_uncertainty_nothing_is_judged():
    one = only([ResultFigure("x", "", 1.0)], [measured(5.0, 0.1)])
    assert (one.difference, one.half_width, one.p_value, one.changed) == (4.0, None, None, False)


@pytest.mark.parametrize(("b", "changed"), [(1.0, False), (1.1, True)])
def test_figures_without_any_error(b, changed):
    one = only([measured(1.0, 0.0)], [measured(b, 0.0)])
    assert (one.changed, one.p_value) == (changed, 0.0 if changed else 1.0)


def test_phases_differ_by_less_than_half_a_turn():
    key = ("cogging", "harmonics.16.phase_rad", "rad")
    a, b = (measured(v, 0.01, field=key[1], unit="rad") for v in (3.1, -3.1))
    assert only([a], [b], key).difference == pytest.approx(2 * np.pi - 6.2)
    assert mean_of([a, b]).value == pytest.approx(np.pi)
    plain = [measured(v, 0.01, field="encoder_offset_rad", unit="rad") for v in (3.1, -3.1)]
    assert only(plain[:1], plain[1:]).difference == pytest.approx(-6.2)


def test_only_what_both_have_is_compared():
    one = measured(1.0, 0.1)
    other = ("verify", "alpha.a", "")
    found = compare({KEY: [one], other: [one]}, {KEY: [one]})
    assert [(d.experiment, d.field, d.unit) for d in found] == [KEY]


def test_of_a_hundred_fields_chance_makes_one_count_in_five_of_a_hundred_comparisons():
    rng = np.random.default_rng(5)
    alarms = 0
    for _ in range(400):
        a, b = (
            {("e", f"f{n}", ""): [measured(value, 1.0)] for n, value in enumerate(noise)}
            for noise in rng.normal(size=(2, 100))
        )
        alarms += any(one.changed for one in compare(a, b))
    assert 8 < alarms < 36  # 20 are expected


def test_real_changes_are_found_among_many_fields():
    a = {("e", f"f{n}", ""): [measured(0.0, 1.0)] for n in range(100)}
    b = {**a, ("e", "f7", ""): [measured(8.0, 1.0)], ("e", "f9", ""): [measured(-7.0, 1.0)]}
    assert [one.field for one in compare(a, b) if one.changed] == ["f7", "f9"]


VALUES = st.floats(-1e6, 1e6)
FIGURES = st.builds(measured, VALUES, st.floats(0, 1e6), st.none() | st.floats(1, 100))


@given(st.lists(FIGURES, min_size=1, max_size=4), st.lists(FIGURES, min_size=1, max_size=4))
def test_a_comparison_turned_round_is_the_same_with_the_other_sign(a, b):
    there, back = only(a, b), only(b, a)
    assert there.difference == -back.difference
    assert there.half_width == pytest.approx(back.half_width)
    assert there.p_value == pytest.approx(back.p_value)
    assert 0 <= there.p_value <= 1
