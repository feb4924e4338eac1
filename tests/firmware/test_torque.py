"""The mean of the ADC's readings."""

from fractions import Fraction
from math import floor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.firmware.library import Library


def average(library: Library, readings: list[int], full_scale: int = 4095) -> tuple[int, bool]:
    values = library.ffi.new("uint16_t[]", readings)
    sample = library.lib.torque_average(values, len(readings), full_scale)
    return sample.counts, sample.valid


@given(st.lists(st.integers(0, 4095), min_size=1, max_size=256))
def test_mean_above_the_middle_halves_up(library: Library, readings: list[int]) -> None:
    mean = floor(Fraction(16 * sum(readings), len(readings)) + Fraction(1, 2))
    valid = all(0 < reading < 4095 for reading in readings)
    assert average(library, readings) == (mean - 2048 * 16, valid)


@given(st.sampled_from([255, 1023, 4095, 16383, 65535]), st.integers(1, 256))
def test_any_adc_any_number_of_readings(library: Library, full_scale: int, count: int) -> None:
    middle = (full_scale + 1) // 2
    assert average(library, [middle] * count, full_scale) == (0, True)
    assert average(library, [full_scale - 1] * count, full_scale) == ((middle - 2) * 16, True)
    assert average(library, [full_scale] * count, full_scale)[1] is False


@pytest.mark.parametrize("place", [0, 1, 7])
@pytest.mark.parametrize("clipped", [0, 4095])
def test_one_clipped_reading_makes_it_invalid(library: Library, place: int, clipped: int) -> None:
    readings = [2048] * 8
    assert average(library, readings)[1]
    readings[place] = clipped
    assert not average(library, readings)[1]


def test_no_reading_is_invalid(library: Library) -> None:
    assert average(library, []) == (0, False)


def test_more_readings_than_fit_are_left_out(library: Library) -> None:
    assert average(library, [2049] * 256 + [4095] * 10) == (16, True)
