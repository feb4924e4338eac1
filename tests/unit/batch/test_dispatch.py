"""Workers die with jobs of others in their hands: every job is done once, but for those of which
workers die, and these are given up after a number of deaths that is bounded."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.batch import dispatch
from motord.batch.dispatch import ChunkResult, carry_out
from motord.batch.error import BatchError
from tests.unit.batch.pools import InlinePool, MortalPool


@pytest.fixture(autouse=True)
def _no_waiting(monkeypatch):
    monkeypatch.setattr(dispatch, "POLL_S", 0.0)


def run(pool, jobs):
    return list(carry_out(pool, jobs, lambda chunk: pool.submit(None, chunk)))


@given(
    jobs=st.integers(0, 100),
    workers=st.integers(1, 4),
    poison=st.sets(st.integers(0, 99), max_size=8),
    allowed=st.integers(0, 3),
    taken_s=st.sampled_from([0.0, 1e-3, 0.1, 10.0]),
    random=st.randoms(use_true_random=False),
)
def test_whoever_kills_no_worker_is_done_once_whatever_others_do(
    jobs, workers, poison, allowed, taken_s, random
):
    pool = MortalPool(workers, poison, random.choice, allowed, taken_s)
    found = run(pool, range(jobs))
    assert sorted(job for job, _ in found) == list(range(jobs))
    assert dict(found) == {n: None if n in poison else 10 * n for n in range(jobs)}
    assert sorted(pool.done) == [n for n in range(jobs) if n not in poison]
    assert pool.most <= 2 * workers
    seen = set()
    for chunk, alone in pool.submitted:
        assert seen.isdisjoint(chunk) or (len(chunk) == 1 and alone)
        seen.update(chunk)
    submitted = Counter(job for chunk, _ in pool.submitted for job in chunk)
    assert max(submitted.values(), default=0) <= 2
    assert max(pool.deaths.values(), default=0) <= allowed + 1


class TimedPool(InlinePool):
    """Carries out chunks of jobs that take 10 ms each, which is nothing here."""

    def submit(self, chunk):
        return super().submit(lambda: ChunkResult(list(chunk), 0.01 * len(chunk)))


def test_a_chunk_is_a_share_of_what_is_left_and_none_takes_long():
    pool, sizes = TimedPool(), []

    def begin(chunk):
        sizes.append(len(chunk))
        return pool.submit(chunk)

    assert sorted(job for job, _ in carry_out(pool, range(1000), begin)) == list(range(1000))
    window = pool.window()
    assert sizes[:window] == [1] * window
    assert max(sizes) == round(dispatch.CHUNK_S / 0.01)
    assert sizes[window:] == sorted(sizes[window:], reverse=True)
    left = 1000
    for size in sizes:
        assert size == 1 or size <= left / (2 * window)
        left -= size
    assert sizes[-1] == 1


def test_no_more_chunks_are_taken_than_the_window_has():
    pool, taken = TimedPool(), []

    def begin(chunk):
        taken.append(chunk)
        return pool.submit(chunk)

    done = set()
    for job, _ in carry_out(pool, range(1000), begin):
        done.add(job)
        assert sum(done.isdisjoint(chunk) for chunk in taken) <= pool.window()


def test_without_jobs_no_worker_is_asked_for():
    assert run(None, []) == []


def test_what_workers_cannot_do_at_all_ends_it():
    pool = InlinePool()

    def none():
        raise BatchError("no")

    with pytest.raises(BatchError, match="no"):
        list(carry_out(pool, [1, 2], lambda chunk: pool.submit(none)))
