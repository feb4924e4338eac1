"""The picture of a figure: what is where, and that it stays in its frame."""

from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.verdict.certificate import HEIGHT, WIDTH, bar
from tests.unit.verdict.made_up import decided

NUMBERS = st.floats(-1e6, 1e6)


def drawn(one):
    """Return ends of all bands, places of all lines; the last band is the interval."""
    root = ElementTree.fromstring(bar(one))
    boxes = [(float(e.get("x")), float(e.get("width"))) for e in root.iter("rect")]
    return [(x, x + w) for x, w in boxes], [float(e.get("x1")) for e in root.iter("line")]


def test_a_value_in_the_middle_of_two_limits():
    """The band takes two thirds of the width; a guard band of 0.196 of its 2 lies inside."""
    (band, inner, interval), (low, high, value) = drawn(decided(0.0, -1.0, 1.0, u=0.1))
    assert band == pytest.approx((20.0, 100.0), abs=0.1)
    assert inner == pytest.approx((20 + 0.196 * 40, 100 - 0.196 * 40), abs=0.2)
    assert interval == pytest.approx((60 - 0.196 * 40, 60 + 0.196 * 40), abs=0.2)
    assert (low, high, value) == pytest.approx((20.0, 100.0, 60.0), abs=0.1)


@pytest.mark.parametrize(("value", "side"), [(2.0, 1), (0.5, -1)])
def test_one_limit_is_in_the_middle_and_the_value_on_its_side(value, side):
    (band, *_), (limit, mark) = drawn(decided(value, high=1.0, u=0.01))
    assert limit == pytest.approx(WIDTH / 2)
    assert band[1] == pytest.approx(WIDTH / 2)
    assert (mark - limit) * side > 10


def test_an_error_that_leaves_nothing_to_pass_has_no_dark_band():
    boxes, _ = drawn(decided(0.0, -1.0, 1.0, u=1.0))
    assert len(boxes) == 2


def test_the_colour_says_the_decision_and_nothing_is_drawn_without_a_value():
    colours = [bar(decided(v, high=1.0)).count("--serious") for v in (9.0, 0.0)]
    assert colours == [2, 0]
    assert bar(decided(None, high=1.0)) == ""
    assert "line" in bar(decided(0.5, high=1.0, u=None))


@given(NUMBERS, st.floats(1e-9, 1e6), NUMBERS, st.floats(1e-6, 1e6), st.integers(0, 2))
def test_all_of_it_is_in_the_frame(value, u, low, width, sides):
    limits = [(low, low + width), (low, None), (None, low)][sides]
    boxes, lines = drawn(decided(value, *limits, u=u))
    for start, end in boxes:
        assert 0 <= start <= end + 0.11
        assert end <= WIDTH + 0.11
    assert all(0 <= x <= WIDTH for x in lines)
    assert HEIGHT < WIDTH
