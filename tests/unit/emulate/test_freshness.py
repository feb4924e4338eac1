"""Feedback without a time of its own leaves in time, or not at all."""

from motord.emulate.freshness import AGE_MAX_NS, HELD_UP_NS, SILENCE_MAX_NS, Freshness

MS = 1_000_000


class Judged:
    def __init__(self) -> None:
        self.now_ns = 10**12
        self.freshness = Freshness(2 * MS, lambda: self.now_ns)

    def leave(self, at_ns: int, listened_ns: int, now_ns: int) -> bool:
        self.now_ns = now_ns
        return self.freshness.currents_leave(at_ns, listened_ns)


def test_the_newest_leaves_and_what_was_due_before_it_does_not() -> None:
    judged, t_ns = Judged(), 10**12
    assert not judged.leave(t_ns - 2 * MS, t_ns, t_ns)
    assert judged.leave(t_ns - 2 * MS + 1, t_ns, t_ns)
    assert judged.freshness.late == 1


def test_old_currents_leave_only_after_a_silence() -> None:
    judged, t_ns = Judged(), 10**12
    assert judged.leave(t_ns, t_ns, t_ns)
    assert judged.leave(t_ns, t_ns, t_ns + AGE_MAX_NS - 1)
    assert not judged.leave(t_ns, t_ns, t_ns + AGE_MAX_NS)
    left_ns = t_ns + AGE_MAX_NS - 1
    later_ns = left_ns + SILENCE_MAX_NS
    assert not judged.leave(later_ns - 10 * MS, later_ns - 9 * MS, later_ns - 1)
    assert judged.leave(later_ns - 10 * MS, later_ns - 9 * MS, later_ns)


def test_a_process_that_was_kept_from_running_is_held_up() -> None:
    judged, t_ns = Judged(), 10**12
    judged.now_ns = t_ns + HELD_UP_NS
    assert judged.freshness.held_up(t_ns)
    assert not judged.freshness.held_up(t_ns + 1)
