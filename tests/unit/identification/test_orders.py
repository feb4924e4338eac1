from math import lcm

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.identification.orders import (
    allowed_orders,
    main_order,
    order_limit,
    periods_per_slot_pitch,
    resolved_order,
)


@pytest.mark.parametrize(
    ("slots", "poles", "periods", "main"),
    [(48, 16, 1, 48), (12, 10, 5, 60), (36, 12, 1, 36), (18, 24, 4, 72), (9, 8, 8, 72)],
)
def test_periods_of_known_motors(slots: int, poles: int, periods: int, main: int) -> None:
    assert periods_per_slot_pitch(slots, poles) == periods
    assert main_order(slots, poles) == main


def test_no_main_order_is_beyond_the_limit() -> None:
    assert order_limit(48, 16) == 512
    assert order_limit(108, 96) == 2 * 864


def test_the_reports_motor() -> None:
    orders = allowed_orders(48, 16, 1000)
    assert orders == (16, 32, 48, 64, 80, 96, 144, 192)
    assert allowed_orders(48, 16, 95) == (16, 32, 48, 64, 80)


def test_a_dislocated_magnet_shows_at_multiples_of_the_slots() -> None:
    assert {12, 24, 36, 48} <= set(allowed_orders(12, 10, 1000))
    assert {10, 20, 60, 120} <= set(allowed_orders(12, 10, 1000))
    assert 5 not in allowed_orders(12, 10, 1000)


@given(
    slots=st.integers(3, 200),
    pole_pairs=st.integers(1, 100),
    highest=st.integers(1, 5000),
)
def test_orders_rise_and_have_a_reason(slots: int, pole_pairs: int, highest: int) -> None:
    orders = allowed_orders(slots, 2 * pole_pairs, highest)
    assert list(orders) == sorted(set(orders))
    assert all(0 < order <= highest for order in orders)
    assert all(order % slots == 0 or order % (2 * pole_pairs) == 0 for order in orders)
    main = main_order(slots, 2 * pole_pairs)
    assert main == lcm(slots, 2 * pole_pairs)
    assert (main in orders) == (main <= highest)
    assert len(orders) <= 30


@pytest.mark.parametrize(
    ("samples", "counts", "most", "per_order", "expected"),
    [
        (1000, 4096, 200, 2, 200),
        (250, 4096, 200, 2, 100),
        (249, 4096, 200, 2, 99),
        (10_000, 256, 4000, 2, 127),  # below half the counts
        (10_000, 257, 4000, 2, 128),
        (10_000, 256, 4000, 4, 64),
        (2, 256, 10, 2, 0),
    ],
)
def test_the_highest_order_that_samples_and_encoder_resolve(
    samples: int, counts: int, most: int, per_order: int, expected: int
) -> None:
    assert resolved_order(samples, counts, most, counts_per_order=per_order) == expected
