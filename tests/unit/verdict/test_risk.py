"""A short part of the campaign: what the rule promises is kept, and a rule that is off is seen."""

import numpy as np
import pytest

from tests.campaigns import verdict
from tests.campaigns.verdict import CASES, at_the_limit, bad_lot, drawn


def broken(case):
    """Return the names of the shares that are beyond what is promised."""
    rng = np.random.default_rng(7)
    return [one.name for one in (*drawn(case, rng), *at_the_limit(case, rng)) if not one.kept]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_shares_are_within_the_risk(case):
    assert broken(case) == []


def test_a_rule_without_the_degrees_of_freedom_is_seen(monkeypatch):
    rule, figure = verdict.decide, verdict.Figure
    monkeypatch.setattr(
        verdict,
        "decide",
        lambda one, *more: rule(figure("", "", one.value, one.standard_uncertainty), *more),
    )
    [case] = [one for one in CASES if one.name == "upper limit, 3 degrees of freedom"]
    assert "passes, at the limit" in broken(case)


def test_a_rule_with_half_of_the_uncertainty_is_seen(monkeypatch):
    rule, figure = verdict.decide, verdict.Figure
    monkeypatch.setattr(
        verdict,
        "decide",
        lambda one, *more: rule(figure("", "", one.value, one.standard_uncertainty / 2), *more),
    )
    assert {"passes, at the limit", "fails, at the limit"} <= set(broken(CASES[0]))


def test_of_a_lot_that_is_bad_every_pass_is_wrong():
    """So the specific risk is no global one: nothing promises it."""
    lot = bad_lot(np.random.default_rng(1))
    assert lot.count == lot.of > 0
