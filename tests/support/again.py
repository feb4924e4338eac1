"""Tests that run again because a stall of the computer has tripped their simulated bench.

Of these benches the supervisor may be away for a second at most, and most of their tests are not
about that: they fail somewhere, for a bench that is not enabled any more. One that is tripped as a
test ends, which passes, is left as well: or the next would find it so. What is forgiven is what
`stalls` forgives, with its proof, and counted there.
"""

from collections.abc import Sequence
from typing import Protocol

import pytest
from _pytest.runner import runtestprotocol

from tests.support.stalls import STALE_S, Stalls, Waits, forgive

TIMES = 3
"""A test is run again at most so many times: one that always fails is red on any computer."""


class Bench(Protocol):
    """A daemon of a simulated bench. `kept`: the stalls since it began, up to its end.

    With its processes their waits are gone. `rate_Hz` is that of its loop.
    """

    kept: Stalls
    rate_Hz: float

    def missed(self, position: int = 0) -> int:
        """Return how many ticks its loop missed by its log from `position` on."""
        ...

    def first_trip(self, position: int = 0) -> str:
        """Return the cause of the first trip in its log from `position` on, "" for none."""
        ...

    def position(self) -> int | None:
        """Return the length of its log, None if it has ended."""
        ...

    def leave_trip(self) -> None:
        """Reset it, if it still runs and can be, and leave it OFF."""
        ...


BENCHES: list[Bench] = []
"""Those that tests of this process have begun, without those that had ended before a test."""


def run(item: pytest.Item, nextitem: pytest.Item | None) -> bool:
    """Run a test, again if it fails and `tripped_by_stall`; report the last time alone."""
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for _ in range(TIMES + 1):
        kept = Stalls()
        before = _before()
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
        failed = any(report.failed for report in reports)
        if not tripped_by_stall(item.nodeid, kept, before, passed=not failed) or not failed:
            break
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def _before() -> list[tuple[int, Waits]]:
    """Return of benches that run where their logs end, and their stalls; forget all others."""
    running = [(bench, at) for bench in BENCHES if (at := bench.position()) is not None]
    BENCHES[:] = [bench for bench, _ in running]
    return [(at, bench.kept.so_far()) for bench, at in running]


def tripped_by_stall(
    where: str, kept: Stalls, before: Sequence[tuple[int, Waits]], *, passed: bool = False
) -> bool:
    """Return whether a stall explains a trip of `BENCHES`, which is then counted and left.

    kept: stalls since the test began; before: what `_before` returned then. Of a test that has
    passed, the benches count that still run.
    """
    forgiven = False
    for number, bench in enumerate(BENCHES):
        runs = bench.position() is not None
        if passed and not runs:
            continue
        position, own = 0, bench.kept
        if number < len(before):
            position, earlier = before[number]
            own = kept if runs else bench.kept.after(earlier)
        own.rate_Hz = bench.rate_Hz
        cause = bench.first_trip(position)
        if cause and _forgiven(where, cause, own, bench.missed(position)):
            bench.leave_trip()
            forgiven = True
    return forgiven


def _forgiven(where: str, cause: str, kept: Stalls, missed: int) -> bool:
    """What a loop missed is no proof by itself: only while this process stood still, too."""
    try:
        forgive(where, cause, kept, STALE_S, kept.stood_still(missed))
    except AssertionError:
        return False
    return True
