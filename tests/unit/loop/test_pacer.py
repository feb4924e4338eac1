"""The pacer on a fake clock: one tick a period at most, in its period, in phase, all counted."""

from hypothesis import given
from hypothesis import strategies as st

from motord.loop.pacer import Pacer
from motord.schema import INT32_MAX, Flag

PERIOD_NS = 1_000_000


class FakeTime:
    """A clock that moves by work and by waiting; waking is late by what is put in `lateness`."""

    def __init__(self, start_ns: int = 0) -> None:
        self.now_ns = start_ns
        self.late_ns = 0
        self.budget_exceeded = False

    def start(self) -> None:
        """Nothing to note."""

    def clock_ns(self) -> int:
        return self.now_ns

    def wait_until(self, deadline_ns: int) -> int:
        self.now_ns = max(self.now_ns, deadline_ns) + self.late_ns
        return self.now_ns


def make(start_ns: int = 0) -> tuple[Pacer, FakeTime]:
    fake = FakeTime(start_ns)
    return Pacer(PERIOD_NS, fake), fake


def test_punctual_ticks() -> None:
    pacer, fake = make(start_ns=123)
    for n in range(1000):
        assert pacer.wait() == 123 + (n + 1) * PERIOD_NS
        assert (pacer.tick, pacer.missed, pacer.late_ns, pacer.flags) == (n, 0, 0, 0)
        fake.now_ns += 300_000


def test_lateness_does_not_accumulate() -> None:
    pacer, fake = make()
    fake.late_ns = 70_000
    for n in range(100):
        assert pacer.wait() == (n + 1) * PERIOD_NS + 70_000
    assert (pacer.missed, pacer.late_ns, pacer.flags) == (0, 70_000, 0)


def test_late_flag_from_half_a_period() -> None:
    pacer, fake = make()
    fake.late_ns = PERIOD_NS // 2
    pacer.wait()
    assert pacer.flags == 0
    fake.late_ns = PERIOD_NS // 2 + 1
    pacer.wait()
    assert pacer.flags == Flag.LATE


def test_stall_while_asleep_skips_the_periods_that_are_over() -> None:
    pacer, fake = make()
    pacer.wait()
    fake.late_ns = 5 * PERIOD_NS + 300_000
    pacer.wait()
    assert (pacer.tick, pacer.missed) == (6, 5)
    assert pacer.late_ns == 5 * PERIOD_NS + 300_000
    assert pacer.flags == Flag.LATE | Flag.AFTER_GAP
    fake.late_ns = 0
    assert pacer.wait() == 8 * PERIOD_NS
    assert (pacer.tick, pacer.missed, pacer.flags) == (7, 5, 0)


def test_work_that_ends_early_in_the_next_period_delays_it() -> None:
    pacer, fake = make()
    pacer.wait()
    fake.now_ns += PERIOD_NS + 400_000
    assert pacer.wait() == 2 * PERIOD_NS + 400_000
    assert (pacer.tick, pacer.missed, pacer.late_ns, pacer.flags) == (1, 0, 400_000, 0)


def test_work_that_ends_late_in_a_period_skips_it() -> None:
    pacer, fake = make()
    pacer.wait()
    fake.now_ns += 3 * PERIOD_NS + 600_000
    assert pacer.wait() == 5 * PERIOD_NS
    assert (pacer.tick, pacer.missed, pacer.late_ns) == (4, 3, 0)
    assert pacer.flags == Flag.AFTER_GAP


def test_lateness_fits_the_record() -> None:
    pacer, fake = make()
    fake.late_ns = 10 * INT32_MAX
    pacer.wait()
    assert pacer.late_ns == INT32_MAX


def test_an_overdrawn_account_costs_one_tick() -> None:
    pacer, fake = make()
    pacer.wait()
    fake.budget_exceeded = True
    fake.now_ns += PERIOD_NS
    assert pacer.wait() == 3 * PERIOD_NS
    assert (pacer.tick, pacer.missed, pacer.late_ns) == (2, 1, 0)
    assert pacer.flags == Flag.AFTER_GAP
    fake.budget_exceeded = False
    assert pacer.wait() == 4 * PERIOD_NS
    assert (pacer.tick, pacer.missed, pacer.flags) == (3, 1, 0)


def test_start_begins_anew() -> None:
    pacer, fake = make()
    fake.late_ns = 3 * PERIOD_NS
    pacer.wait()
    fake.late_ns = 0
    pacer.start()
    begun_ns = fake.now_ns
    assert pacer.wait() == begun_ns + PERIOD_NS
    assert (pacer.tick, pacer.missed) == (0, 0)


DURATIONS = st.one_of(
    st.integers(0, PERIOD_NS // 3), st.integers(0, 2 * PERIOD_NS), st.integers(0, 50 * PERIOD_NS)
)


@given(
    st.lists(st.tuples(DURATIONS, DURATIONS, st.booleans()), max_size=100), st.integers(0, 2**40)
)
def test_any_history_of_stalls(history: list[tuple[int, int, bool]], start_ns: int) -> None:
    pacer, fake = make(start_ns)
    before, gaps = -1, 0
    for late_ns, work_ns, budget_exceeded in history:
        fake.late_ns, fake.budget_exceeded = late_ns, budget_exceeded
        woke_ns = pacer.wait()
        gap = pacer.tick - before - 1
        gaps += gap
        due_ns = start_ns + (pacer.tick + 1) * PERIOD_NS
        assert pacer.tick > before
        assert due_ns <= woke_ns < due_ns + PERIOD_NS
        assert pacer.missed == gaps
        assert bool(pacer.flags & Flag.AFTER_GAP) == (gap > 0)
        assert bool(pacer.flags & Flag.LATE) == (pacer.late_ns > PERIOD_NS // 2)
        before = pacer.tick
        fake.now_ns += work_ns
