from hypothesis import given
from hypothesis import strategies as st

from motord.wire.sequence import SequenceCheck


@given(st.lists(st.sampled_from("gcl"), max_size=200), st.integers(0, 65535))
def test_each_bad_frame_counts_once(fates: list[str], first: int) -> None:
    """Frames arrive good, corrupt or not at all, few enough of the latter at a time."""
    check = SequenceCheck(65536)
    check.accept(first)
    for number, fate in enumerate(fates, start=first + 1):
        if fate == "g":
            assert check.accept(number % 65536)
        elif fate == "c":
            check.corrupt()
    check.accept((first + 1 + len(fates)) % 65536)
    assert check.errors == sum(fate != "g" for fate in fates)


def test_a_repeated_number_is_refused_and_counted() -> None:
    check = SequenceCheck(16)
    assert check.accept(15)
    assert check.accept(0)
    assert not check.accept(0)
    assert check.errors == 1
    assert check.accept(1)
    assert check.errors == 1


def test_a_sender_that_started_anew_is_one_error() -> None:
    check = SequenceCheck(65536)
    check.accept(5000)
    assert check.accept(0)
    assert check.errors == 1


def test_restart_expects_any_number() -> None:
    check = SequenceCheck(65536)
    check.accept(5000)
    check.restart()
    assert check.accept(77)
    assert check.errors == 0


def test_without_numbers_only_corrupt_frames_count() -> None:
    check = SequenceCheck(0)
    check.corrupt()
    assert check.accept(0)
    assert check.accept(0)
    assert check.errors == 1


@given(st.lists(st.one_of(st.none(), st.integers(0, 15)), max_size=60))
def test_errors_never_fall(numbers: list[int | None]) -> None:
    check, before = SequenceCheck(16), 0
    for number in numbers:
        if number is None:
            check.corrupt()
        else:
            check.accept(number)
        assert check.errors >= before
        before = check.errors
