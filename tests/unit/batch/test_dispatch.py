"""Workers die with jobs of others in their hands: every job is done once, but for those of which
workers die, and these are given up after a number of deaths that is bounded."""

from itertools import count

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.batch import dispatch
from motord.batch.dispatch import carry_out
from motord.batch.error import BatchError
from tests.unit.batch.pools import InlinePool, MortalPool


@pytest.fixture(autouse=True)
def _no_waiting(monkeypatch):
    monkeypatch.setattr(dispatch, "POLL_S", 0.0)


def run(pool, jobs):
    return list(carry_out(pool, jobs, lambda job: pool.submit(None, job)))


@given(
    jobs=st.integers(0, 30),
    workers=st.integers(1, 4),
    poison=st.sets(st.integers(0, 29), max_size=8),
    allowed=st.integers(0, 3),
    random=st.randoms(use_true_random=False),
)
def test_whoever_kills_no_worker_is_done_once_whatever_others_do(
    jobs, workers, poison, allowed, random
):
    pool = MortalPool(workers, poison, random.choice, allowed)
    found = run(pool, range(jobs))
    assert sorted(job for job, _ in found) == list(range(jobs))
    assert dict(found) == {n: None if n in poison else 10 * n for n in range(jobs)}
    assert sorted(pool.done) == [n for n in range(jobs) if n not in poison]
    assert pool.most <= 2 * workers
    assert max(map(pool.submitted.count, pool.submitted), default=0) <= 2
    assert max(pool.deaths.values(), default=0) <= allowed + 1


def test_no_more_jobs_are_taken_than_the_window_has():
    taken = count()
    jobs = (next(taken) for _ in range(1000))
    pool = InlinePool()
    for _, (_, result) in zip(
        range(4), carry_out(pool, jobs, lambda job: pool.submit(int, job)), strict=False
    ):
        assert result is not None
    assert next(taken) <= 3 * pool.window()


def test_without_jobs_no_worker_is_asked_for():
    assert run(None, []) == []


def test_what_workers_cannot_do_at_all_ends_it():
    pool = InlinePool()

    def none():
        raise BatchError("no")

    with pytest.raises(BatchError, match="no"):
        list(carry_out(pool, [1, 2], lambda job: pool.submit(none)))
