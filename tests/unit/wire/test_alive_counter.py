import pytest

from motord.wire.sequence import RESTART_FRAMES, AliveCounter

SIXTEEN_BITS = 65536


@pytest.mark.parametrize("modulus", [2, 4, 16, 256, SIXTEEN_BITS])
def test_a_sender_that_started_anew_is_taken_within_eight_frames(modulus: int) -> None:
    for first in range(min(modulus, 256)):
        counter = AliveCounter(modulus)
        counter.accept(modulus // 3)
        taken = [counter.accept((first + later) % modulus) for later in range(2 * RESTART_FRAMES)]
        assert taken == sorted(taken)  # once it is taken, every frame is
        assert taken[RESTART_FRAMES]


@pytest.mark.parametrize(
    ("modulus", "frames"),
    [
        (modulus, frames)
        for modulus in (16, 256, SIXTEEN_BITS)
        for frames in range(1, min(RESTART_FRAMES + 1, modulus // 2))
    ],
)
def test_frames_that_are_repeated_for_ever_are_not_taken(modulus: int, frames: int) -> None:
    """As by a converter on the way that goes on with what it had when the sender fell silent."""
    counter, last = AliveCounter(modulus), 1000
    for number in range(last):
        assert counter.accept(number % modulus)
    repeated = [number % modulus for number in range(last - frames, last)]
    assert not any(counter.accept(number) for number in 50 * repeated)
    assert counter.errors == 50 * frames
    assert counter.accept(last % modulus)


@pytest.mark.parametrize("back", range(1, RESTART_FRAMES - 1))
def test_frames_that_overtake_each_other_are_taken_in_order(back: int) -> None:
    counter = AliveCounter(16)
    sent = [each for number in range(100) for each in (number, max(number - back, 0))]
    assert [each for each in sent if counter.accept(each % 16)] == list(range(100))


def test_of_two_senders_one_is_followed() -> None:
    for ahead in range(SIXTEEN_BITS - 20, SIXTEEN_BITS + 20):
        counter, taken = AliveCounter(SIXTEEN_BITS), set()
        for number in range(100):
            for sender, sent in enumerate((number, number + ahead)):
                if counter.accept(sent % SIXTEEN_BITS) and number > RESTART_FRAMES:
                    taken.add(sender)
        assert len(taken) == 1
        assert counter.errors > 80


def test_a_message_without_counter_has_no_old_frames() -> None:
    counter = AliveCounter(0)
    counter.corrupt()
    assert counter.accept(0)
    assert counter.accept(0)
    assert counter.errors == 1
