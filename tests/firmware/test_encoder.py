"""Gray code and the filter of the encoder's lines: every transition, every glitch."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.firmware.library import Library

LINES = 12
COUNTS = 1 << LINES


class Filter:
    """The filter, with the lines of `lines` and `step_max` counts a reading."""

    def __init__(self, library: Library, step_max: int = 5, lines: int = LINES) -> None:
        self._lib = library.lib
        self.state: Any = library.ffi.new("struct gray_filter *")
        self._lib.gray_filter_init(self.state, lines)
        self.state.step_max = step_max

    def take(self, position: int, flipped: int = 0) -> tuple[int, bool]:
        """Return the reported position and validity for the lines of `position`, some flipped."""
        reading = self._lib.gray_filter_take(self.state, gray(position) ^ flipped)
        return binary(reading.lines), reading.valid

    def settle(self, position: int) -> None:
        for _ in range(self._lib.GRAY_AGREEING):
            taken = self.take(position)
        assert taken == (position, True)


def gray(position: int) -> int:
    return position ^ position >> 1


def binary(lines: int) -> int:
    """Decode bit by bit, from the top."""
    position = 0
    for bit in reversed(range(24)):
        position |= (lines >> bit & 1 ^ position >> (bit + 1) & 1) << bit
    return position


def apart(a: int, b: int) -> int:
    return min((a - b) % COUNTS, (b - a) % COUNTS)


def test_every_position_there_and_back(library: Library) -> None:
    lib = library.lib
    for position in range(COUNTS):
        assert lib.gray_encode(position) == gray(position)
        assert lib.gray_decode(gray(position)) == position


@given(st.integers(0, (1 << 24) - 1))
def test_wide_encoders(library: Library, position: int) -> None:
    assert library.lib.gray_decode(gray(position)) == position == binary(gray(position))


@pytest.mark.parametrize("step", [1, -1, 5, -5])
def test_every_transition_is_taken(library: Library, step: int) -> None:
    """All the way round and back over the zero, in steps as large as the shaft can make."""
    encoder = Filter(library)
    encoder.settle(0)
    position = 0
    for _ in range(COUNTS + 3):
        position = (position + step) % COUNTS
        assert encoder.take(position) == (position, True)


def test_every_glitch_of_one_line_at_every_position(library: Library) -> None:
    """What is reported is never further from the truth than the shaft can turn in a reading."""
    encoder = Filter(library, step_max=5)
    encoder.settle(0)
    for position in range(COUNTS):
        for line in range(LINES):
            encoder.take(position)
            reported, valid = encoder.take(position, 1 << line)
            assert valid
            assert apart(reported, position) <= 5
            assert encoder.take(position) == (position, True)


@pytest.mark.parametrize("position", [0, 1, 1234, 2047, 2048, 4095])
def test_every_glitch_of_any_lines(library: Library, position: int) -> None:
    encoder = Filter(library, step_max=5)
    encoder.settle(position)
    for flipped in range(1, COUNTS):
        reported, valid = encoder.take(position, flipped)
        assert valid
        assert apart(reported, position) <= 5
        assert encoder.take(position) == (position, True)


@pytest.mark.parametrize("length", [1, 2, 3])
def test_short_glitches_are_bridged_while_the_shaft_turns(library: Library, length: int) -> None:
    encoder = Filter(library, step_max=5)
    encoder.settle(100)
    for number in range(length):
        assert encoder.take(105 + 5 * number, 1 << 11) == (100, True)
    assert encoder.take(100 + 5 * (length + 1)) == (100 + 5 * (length + 1), True)


def test_longer_ones_are_reported_as_read_and_invalid(library: Library) -> None:
    encoder = Filter(library, step_max=1)
    encoder.settle(100)
    wrong = binary(gray(100) ^ 1 << 11)
    readings = [encoder.take(100, 1 << 11) for _ in range(15)]
    assert readings == [(100, True)] * 3 + [(wrong, False)] * 12
    assert encoder.take(100) == (100, True)


@pytest.mark.parametrize(("distance", "taken"), [(5, True), (6, False), (-5, True), (-6, False)])
def test_out_of_reach_by_one_count_is_not_taken(
    library: Library, distance: int, taken: bool
) -> None:
    for start in (3, 100, COUNTS - 2):
        encoder = Filter(library, step_max=5)
        encoder.settle(start)
        there = (start + distance) % COUNTS
        assert encoder.take(there) == (there if taken else start, True)


def test_readings_that_agree_make_a_new_position(library: Library) -> None:
    """After 16 of them; one that does not agree starts the count anew."""
    encoder = Filter(library, step_max=5)
    encoder.settle(0)
    readings = [encoder.take(2000 + number)[1] for number in range(15)]
    assert readings == [True] * 3 + [False] * 12
    assert encoder.take(1000) == (1000, False)
    readings = [encoder.take(2000 + number)[1] for number in range(16)]
    assert readings == [False] * 15 + [True]
    assert encoder.take(2016) == (2016, True)


def test_at_first_there_is_no_position(library: Library) -> None:
    encoder = Filter(library, step_max=5)
    readings = [encoder.take(7 + number) for number in range(16)]
    assert readings == [(7 + number, False) for number in range(15)] + [(22, True)]


def test_noise_is_never_a_position(library: Library) -> None:
    encoder = Filter(library, step_max=1)
    for number in range(500):
        assert encoder.take(number * 1000 % COUNTS)[1] is False


def test_the_reach_grows_with_the_time_since_the_last_good_reading(library: Library) -> None:
    encoder = Filter(library, step_max=3)
    encoder.settle(0)
    for number in range(9):
        encoder.take(2000 + 40 * number % 80)
    assert encoder.take(31)[1] is False
    assert encoder.take(33) == (33, True)  # eleven readings, three counts each


def test_after_a_long_time_the_shaft_may_be_anywhere(library: Library) -> None:
    encoder = Filter(library, step_max=1)
    encoder.settle(0)
    for number in range(3 * COUNTS):
        encoder.take(2048 if number % 2 else 1000 + number % 500)
        if encoder.state.ticks == 0:
            break
    assert number > 900
    encoder.settle(5)


@given(
    st.integers(1, 400),
    st.integers(100, 20_000),
    st.integers(1, 24),
)
def test_the_step_covers_the_speed(
    library: Library, speed_max_Hz: int, tick_Hz: int, lines: int
) -> None:
    encoder = Filter(library, lines=lines)
    library.lib.gray_filter_speed(encoder.state, speed_max_Hz, tick_Hz)
    turned = -(-speed_max_Hz * (1 << lines) // tick_Hz)
    assert encoder.state.step_max == turned + 1
    assert encoder.state.mask == (1 << lines) - 1


def test_lines_beyond_the_encoders_mean_nothing(library: Library) -> None:
    encoder = Filter(library)
    encoder.settle(9)
    assert encoder.take(9, 0xFFF << LINES) == (9, True)
