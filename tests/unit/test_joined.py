"""Ticks are joined and chosen as they are, also where they are a slice or of another type."""

import numpy as np
import pytest

from motord.schema import TICK_DTYPE, joined, rows_of


def ticks(first: int, count: int) -> np.ndarray:
    block = np.zeros(count, TICK_DTYPE)
    block["tick"] = np.arange(first, first + count)
    block["torque_Nm"] = 0.5 * block["tick"]
    return block


@pytest.mark.parametrize("counts", [(3,), (2, 0, 5), (0, 0)])
def test_ticks_of_blocks_follow_each_other(counts: tuple[int, ...]) -> None:
    firsts = np.cumsum([0, *counts[:-1]])
    blocks = [ticks(int(first), count) for first, count in zip(firsts, counts, strict=True)]
    whole = joined(blocks)
    assert whole.dtype == TICK_DTYPE
    assert whole.tobytes() == ticks(0, sum(counts)).tobytes()
    assert not any(np.shares_memory(whole, block) for block in blocks)


def test_every_second_tick() -> None:
    assert joined([ticks(0, 9)[::2], ticks(10, 4)[::2]])["tick"].tolist() == [0, 2, 4, 6, 8, 10, 12]


def test_blocks_of_another_type_become_that_of_the_first() -> None:
    small, large = np.dtype([("a", "f4"), ("b", "i2")]), np.dtype([("a", "f8"), ("b", "i8")])
    both = joined([np.array([(1.5, 2)], large), np.array([(2.5, 3)], small)])
    assert both.dtype == large
    assert both.tolist() == [(1.5, 2), (2.5, 3)]


def test_texts() -> None:
    text = np.dtype([("name", object)])
    assert joined([np.array([("a",)], text), np.array([("b",)], text)]).tolist() == [("a",), ("b",)]


@pytest.mark.parametrize("step", [1, 2])
@pytest.mark.parametrize("columns", [["tick", "torque_Nm"], list(TICK_DTYPE.names or ())])
def test_ticks_are_chosen_as_numpy_chooses_them(step: int, columns: list[str]) -> None:
    records = ticks(0, 12)[columns][::step]
    for chosen in (records["tick"] % 3 > 0, records["tick"] < 0, slice(1, 3)):
        found = rows_of(records, chosen)
        assert found.dtype == records.dtype
        assert found.tolist() == records[chosen].tolist()
