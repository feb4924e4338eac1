"""A few trials of the campaign that compares the joint estimator with the truth."""

from dataclasses import replace

import numpy as np
import pytest

from tests.campaigns.estimator import Trial, judge, trial


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    return [trial(seed) for seed in range(1, 5)]


def test_the_truth_lies_within_the_stated_errors(trials: list[Trial]) -> None:
    ratio = np.array([t.error / t.half_width for t in trials])
    assert np.abs(ratio).max() < 2.0
    assert 0.15 < np.sqrt((ratio**2).mean()) < 0.8


def test_delta_epsilon_is_measured(trials: list[Trial]) -> None:
    assert trials[0].names[0] == "delta epsilon"
    assert max(abs(t.error[0]) for t in trials) < 0.01
    assert all(1e-4 < t.delta_epsilon_stderr < 5e-3 for t in trials)
    assert 1.96e-4 < np.median([t.half_width[0] for t in trials]) < 9.8e-3


def test_the_residual_estimator_is_biased_where_the_joint_one_is_not(trials: list[Trial]) -> None:
    assert np.abs(np.mean([t.alpha for t in trials], axis=0)).max() < 1.5e-3
    assert np.abs(np.mean([t.residual_alpha for t in trials], axis=0)).max() > 0.02


def test_a_campaign_reports_what_was_not_kept(trials: list[Trial]) -> None:
    overconfident = [
        replace(t, half_width=t.half_width * 1e-3, alpha=t.alpha + 0.01, residual_alpha=t.alpha)
        for t in trials
    ]
    failures = judge(overconfident).failures
    assert sum("in its interval" in failure for failure in failures) > 10
    assert any("joint" in failure for failure in failures)
    assert any("residual" in failure for failure in failures)
    off = [replace(t, error=t.error + 0.02) for t in trials]
    assert any("delta epsilon is off" in failure for failure in judge(off).failures)
