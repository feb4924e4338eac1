"""A recorder killed at random moments, at the rate of a real bench, reads back whole."""

import pytest

from tests.benchmarks.bench_kills import MISSING_LIMIT_S, kill_often

pytestmark = pytest.mark.system


def test_a_recorder_killed_again_and_again_loses_nothing_that_the_ring_holds():
    outcome = kill_often(rate_Hz=1000, kills=3, seed=1)
    assert outcome.unreadable == []
    assert len(outcome.missing_s) == 3
    both = zip(outcome.missing_s, outcome.late_s, strict=True)
    assert max(missing_s - late_s for missing_s, late_s in both) <= MISSING_LIMIT_S
    assert (outcome.gone, outcome.double) == (0, 0)
    assert outcome.ticks > 1000
