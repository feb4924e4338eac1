"""What is missing between ticks: on the way, in the loop, or by another loop."""

import numpy as np
import pytest

from motord.client.decoding import decode_ticks
from motord.client.subscription import TickLosses, TickSubscription
from motord.schema import TICK, TICK_DTYPE
from motord.wire.ticks.blocks import BlockCodec


def block(ticks, missed=0):
    rows = np.zeros(len(ticks), TICK_DTYPE)
    rows["tick"], rows["missed"] = ticks, missed
    return rows


@pytest.mark.parametrize(
    ("blocks", "losses"),
    [
        ([block([5, 6, 7]), block([8, 9])], (0, 0, 0)),
        ([block([5, 6]), block([9])], (2, 0, 0)),
        ([block([5, 6]), block([9], missed=2)], (0, 2, 0)),
        ([block([5, 6], missed=3), block([9, 10], missed=4)], (1, 1, 0)),
        ([block([5, 8, 9], missed=[0, 1, 1])], (1, 1, 0)),
        ([block([900, 901]), block([3, 4])], (0, 0, 1)),
        ([block([900, 901, 0, 1, 4])], (2, 0, 1)),
        ([block([5, 6], missed=7), block([8], missed=0)], (0, 0, 1)),
        ([block([2**40, 2**40 + 3])], (2, 0, 0)),
        ([block([5]), block([]), block([7])], (1, 0, 0)),
    ],
)
def test_a_gap_differs_from_a_missed_period_and_a_restart(session, blocks, losses):
    ticks = subscription(session)
    for each in blocks:
        ticks._queue(each)
        assert ticks.get(0.0) is each
    assert ticks.losses == TickLosses(*losses)
    assert ticks.lost_ticks == losses[0]


def test_what_is_not_read_in_time_is_lost_and_counted(session):
    ticks = subscription(session, kept=2)
    for first in (0, 10, 20, 30):
        ticks._queue(block(range(first, first + 10)))
    assert ticks.get(0.0)["tick"][0] == 20
    assert ticks.lost == 2  # blocks
    assert ticks.losses == TickLosses()  # nothing was read before them
    for first in (40, 50, 60):
        ticks._queue(block(range(first, first + 10)))
    assert ticks.get(0.0)["tick"][0] == 50
    assert ticks.losses == TickLosses(lost_ticks=20)


def test_a_malformed_block_is_a_loss(session):
    ticks = subscription(session)
    for good in (block([1, 2]), block([5, 6])):
        session.sends(BlockCodec(TICK).encode_list(good))
        session.sends(b"\xff")
        ticks.get(0.0)
    assert (ticks.malformed, ticks.losses) == (2, TickLosses(lost_ticks=2))


def subscription(session, kept=100):
    return TickSubscription(session, "ticks", decode_ticks, kept=kept)
