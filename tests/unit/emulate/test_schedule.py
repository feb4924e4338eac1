from hypothesis import given
from hypothesis import strategies as st

from motord.emulate.clock import Schedule

SECOND_NS = 1_000_000_000


@given(st.integers(1, 20_000), st.integers(0, 2**60), st.integers(1, 200))
def test_instants_are_absolute_and_never_drift(rate_Hz, start_ns, steps):
    schedule = Schedule(start_ns, rate_Hz)
    for n in range(steps):
        assert schedule.next_ns == start_ns + n * SECOND_NS // rate_Hz
        assert not schedule.due(schedule.next_ns - 1)
        assert schedule.due(schedule.next_ns)


@given(st.integers(1, 20_000), st.integers(0, 10 * SECOND_NS))
def test_skipping_leaves_out_what_is_past_and_nothing_else(rate_Hz, later_ns):
    schedule = Schedule(0, rate_Hz)
    skipped = schedule.skip_to(later_ns)
    assert schedule.next_ns >= later_ns
    assert schedule.next_ns == skipped * SECOND_NS // rate_Hz
    if skipped:
        assert (skipped - 1) * SECOND_NS // rate_Hz < later_ns
    assert schedule.skip_to(later_ns) == 0


def test_a_new_rate_starts_anew():
    schedule = Schedule(0, 10)
    schedule.due(0)
    schedule.restart(5, 1000)
    assert (schedule.next_ns, schedule.rate_Hz) == (5, 1000)
    schedule.due(5)
    assert schedule.next_ns == 1_000_005
