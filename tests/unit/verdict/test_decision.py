"""The decision rule against tables of the distributions, and what must hold of any rule."""

from math import inf, nan

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from motord.verdict.certificate import percent_up
from motord.verdict.decision import MotorVerdict
from tests.unit.verdict.made_up import RISK, decided

VALUES = st.floats(-3.0, 3.0)
ERRORS = st.floats(1e-3, 2.0)
FREEDOMS = st.one_of(st.none(), st.floats(1.0, 200.0))
RISKS = st.floats(1e-3, 0.4)
RANK = {"fail": 0, "undecidable": 1, "pass": 2}
ONE_NORMAL = 1.959964
"""Of the normal distribution, 2.5 % lie beyond."""


@pytest.mark.parametrize(
    ("value", "low", "high", "u", "probability"),
    [
        (-5.47, None, -5.40, 0.05, 0.919243),  # Phi(1.40)
        (509.7, 490.0, None, 8.6, 0.989011),  # Phi(2.2907)
        (13.6, 12.5, 16.3, 1.8, 0.662630),  # Phi(1.5) - Phi(-0.6111)
        (1.0, 0.0, 1.0, 0.1, 0.5),
        (1.0, 0.0, 2.0, 1.0, 0.682689),
        (3.0, 0.0, 2.0, 1.0, 0.157305),
    ],
)
def test_conformance_probabilities_are_those_of_the_normal_table(value, low, high, u, probability):
    assert decided(value, low, high, u=u).probability == pytest.approx(probability, abs=2e-6)


@pytest.mark.parametrize(
    ("freedom", "risk", "quantile"),
    [
        (None, 0.025, ONE_NORMAL), (None, 0.05, 1.644854), (10.0, 0.025, 2.228139),
        (5.0, 0.05, 2.015048), (1.0, 0.025, 12.706205), (0.4, 0.025, 12.706205),
    ],
)  # fmt: skip
def test_a_value_passes_from_the_guard_band_on_and_fails_from_it_on_outside(
    freedom, risk, quantile
):
    """One-sided: quantiles of Student's t; less than one degree of freedom counts as one."""
    for side in (1, -1):
        limits = {"high": 7.0} if side > 0 else {"low": 7.0}

        def at(distance, limits=limits, side=side):
            value = 7.0 - side * 0.1 * quantile * distance
            return decided(value, risk=risk, u=0.1, freedom=freedom, **limits)

        assert at(1.0).guard_band == pytest.approx(0.1 * quantile, rel=1e-6)
        assert [at(x).decision for x in (1.0001, 0.9999, -0.9999, -1.0001)] == [
            *("pass", "undecidable", "undecidable", "fail"),
        ]


def test_both_limits_count():
    """In the middle of limits that are 2 U apart, both tails are outside: 5 % and not 2.5 %."""
    middle = decided(0.0, -ONE_NORMAL, ONE_NORMAL, u=1.0)
    assert middle.probability == pytest.approx(0.95, abs=1e-6)
    assert middle.decision == "undecidable"
    assert decided(0.0, -2.2415, 2.2415, u=1.0).decision == "pass"  # 1.25 % on each side
    assert decided(0.0, -2.2413, 2.2413, u=1.0).decision == "undecidable"


@pytest.mark.parametrize("u", [None, 0.0, -0.1, nan, inf])
def test_without_an_uncertainty_nothing_is_decided(u):
    one = decided(5.0, high=1.0, u=u)
    assert (one.decision, one.probability) == ("undecidable", None)
    assert one.reason == "its uncertainty is not stated"


@pytest.mark.parametrize("value", [None, nan, inf])
def test_without_a_value_nothing_is_decided(value):
    assert decided(value, high=1.0).decision == "undecidable"


@pytest.mark.parametrize("value", [0.0, 1.0, 9.0])
def test_a_doubt_goes_before_any_decision(value):
    one = decided(value, high=1.0, doubt="serious finding x")
    assert (one.decision, one.reason) == ("undecidable", "serious finding x")


@given(VALUES, ERRORS, FREEDOMS, RISKS, st.floats(0.0, 2.0))
def test_a_value_farther_from_its_limit_is_decided_no_worse(value, u, freedom, risk, step):
    near = decided(value, high=1.0, u=u, freedom=freedom, risk=risk)
    far = decided(value - step, high=1.0, u=u, freedom=freedom, risk=risk)
    assert far.probability >= near.probability
    assert RANK[far.decision] >= RANK[near.decision]


@given(VALUES, ERRORS, FREEDOMS, RISKS, st.floats(0.1, 2.0))
def test_symmetric_limits_treat_both_sides_alike(value, u, freedom, risk, limit):
    one = decided(value, -limit, limit, u=u, freedom=freedom, risk=risk)
    other = decided(-value, -limit, limit, u=u, freedom=freedom, risk=risk)
    assert one.probability == pytest.approx(other.probability, abs=1e-12)
    assume(all(abs(1 - one.probability - edge) > 1e-9 for edge in (risk, 1 - risk)))
    assert one.decision == other.decision


@given(VALUES, ERRORS, FREEDOMS, RISKS, st.floats(0.1, 2.0), st.floats(0.01, 1.0))
def test_a_smaller_uncertainty_takes_back_no_decision(value, u, freedom, risk, limit, share):
    for limits in ((-limit, limit), (None, limit), (-limit, None)):
        before = decided(value, *limits, u=u, freedom=freedom, risk=risk)
        after = decided(value, *limits, u=share * u, freedom=freedom, risk=risk)
        assert before.decision in ("undecidable", after.decision)


@given(VALUES, ERRORS, FREEDOMS, RISKS, st.floats(0.1, 2.0))
def test_only_a_value_inside_passes_and_only_one_outside_fails(value, u, freedom, risk, limit):
    decision = decided(value, -limit, limit, u=u, freedom=freedom, risk=risk).decision
    assert decision == "undecidable" or (decision == "pass") == (abs(value) < limit)


def test_a_measurement_that_is_too_coarse_for_its_limits_rejects_nothing():
    """The value is in the middle of a band of a fiftieth of its error: outside with 99.2 %."""
    coarse = decided(0.0, -0.01, 0.01, u=1.0)
    assert coarse.probability == pytest.approx(0.008, abs=1e-3)
    assert coarse.decision == "undecidable"
    assert decided(2.24, -0.001, 0.001, u=1.0).decision == "undecidable"  # 1.25 % on each side
    assert decided(2.26, -0.001, 0.001, u=1.0).decision == "fail"


@given(VALUES, ERRORS, FREEDOMS, RISKS, st.floats(1.0, 3.0))
def test_wider_limits_decide_no_worse(value, u, freedom, risk, wider):
    narrow = decided(value, -1.0, 1.0, u=u, freedom=freedom, risk=risk)
    wide = decided(value, -wider, wider, u=u, freedom=freedom, risk=risk)
    assert RANK[wide.decision] >= RANK[narrow.decision]


@pytest.mark.parametrize(
    ("values", "decision"),
    [
        ((0.0, 0.0), "pass"), ((0.0, 1.0), "undecidable"), ((1.0, 9.0), "fail"),
        ((0.0, 9.0), "fail"), ((None, 9.0), "fail"), ((None, 0.0), "undecidable"),
    ],
)  # fmt: skip
def test_one_figure_that_fails_fails_the_motor(values, decision):
    assert MotorVerdict(tuple(decided(v, high=1.0) for v in values)).decision == decision


def test_the_probabilities_of_all_figures_add_up_to_a_bound():
    two = MotorVerdict((decided(0.8, high=1.0), decided(0.7, high=1.0)))
    assert two.nonconformance_bound == pytest.approx(0.022750 + 0.001350, abs=1e-6)
    assert (
        MotorVerdict((decided(0.8, high=1.0), decided(None, high=1.0))).nonconformance_bound is None
    )
    assert MotorVerdict((decided(2.0, high=1.0),) * 3).nonconformance_bound == 1.0


def test_reasons_name_their_figures():
    near = decided(1.0, high=1.0)
    reasons = MotorVerdict((near, near, decided(0.0, high=1.0), decided(1.0, high=1.0, u=None)))
    assert list(reasons.reasons()) == [
        "undecidable, a limit is within the uncertainty: alpha, phase a; alpha, phase a",
        "undecidable, its uncertainty is not stated: alpha, phase a",
    ]
    assert RISK == 0.025


@pytest.mark.parametrize(
    ("bound", "shown"),
    [
        (1e-5, "0.05 %"),
        (0.0005, "0.1 %"),
        (0.0201, "2.1 %"),
        (0.01 + 0.02, "3.0 %"),
        (1.0, "100.0 %"),
    ],
)
def test_what_a_probability_is_at_most_is_rounded_up(bound: float, shown: str) -> None:
    assert percent_up(bound) == shown
