"""Arguments that a compiled function finds by their address."""

import gc

import numpy as np
import pytest

from motord.jit import Frame, jit_holding_gil, records_at
from motord.schema import record_dtype

PAIR = record_dtype([("x", "f8"), ("n", "i4")])


@jit_holding_gil
def add_up(frame: int, count: int) -> float:
    """Sum array 0, note sum and count in the record that is array 1."""
    total = 0.0
    values = records_at(frame, 0, count, np.float64)
    for i in range(count):
        total += values[i]
    pair = records_at(frame, 1, 1, PAIR)[0]
    pair.x, pair.n = total, count
    return total


@pytest.mark.kernel
def test_a_compiled_function_reads_and_writes_through_a_frame() -> None:
    values, pair = np.arange(5.0), np.zeros(1, PAIR)
    frame = Frame(values, pair)
    assert add_up(frame.address, 5) == 10.0
    assert (pair[0].x, pair[0].n) == (10.0, 5)
    frame.replace(0, values + 1.0)  # nothing else refers to the sum of the two
    gc.collect()
    assert add_up(frame.address, 5) == 15.0


def test_a_frame_keeps_its_arrays() -> None:
    frame = Frame(np.full(1000, 2.0), np.zeros(1, PAIR))
    gc.collect()
    assert add_up(frame.address, 1000) == 2000.0


def test_what_would_be_read_wrongly_is_refused() -> None:
    values, pair = np.arange(5.0), np.zeros(1, PAIR)
    frame = Frame(values, pair)
    with pytest.raises(ValueError, match="argument 0 is float64"):
        frame.replace(0, np.arange(4.0))
    with pytest.raises(ValueError, match="argument 1"):
        frame.replace(1, np.zeros(1))
    with pytest.raises(ValueError, match="contiguous"):
        Frame(np.arange(10.0)[::2])
