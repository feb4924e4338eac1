"""The time that drivers give a device to start: however it passes, it ends with one look at 0."""

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.hal import countdown


@given(steps_s=st.lists(st.integers(0, 10), max_size=20), timeout_s=st.integers(0, 50))
def test_each_look_has_the_time_left_and_the_last_one_none(
    steps_s: list[int], timeout_s: int
) -> None:
    now_s = 0.0

    def monotonic() -> float:
        nonlocal now_s
        now_s += steps_s.pop() if steps_s else 1.0
        return now_s

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(countdown, "time", SimpleNamespace(monotonic=monotonic))
        *before_s, last_s = countdown.countdown_s(timeout_s)
    assert last_s == 0.0
    assert all(0.0 < left_s <= timeout_s for left_s in before_s)
    assert before_s == sorted(before_s, reverse=True)


def test_a_clock_that_stands_still_does_not_take_the_last_look() -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(countdown, "time", SimpleNamespace(monotonic=lambda: 3.0))
        one = countdown.Countdown(0.0)
        assert one.left_s() == 0.0
        for _ in range(2):
            with pytest.raises(TimeoutError):
                one.left_s()
