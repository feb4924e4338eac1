"""Decimation of ticks: at most so many a second, nothing of a spike lost, what is lost counted."""

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from motord.foxglove.decimation import EXTREMES_NAME, Decimator, extremes_descriptor_set
from motord.schema import TICK, TICK_DTYPE

RATE_HZ = 10_000
START_NS = 1_700_000_000_000_000_000


def ticks(count, first=0, rate_Hz=RATE_HZ):
    block = np.zeros(count, TICK_DTYPE)
    number = first + np.arange(count)
    block["tick"] = number
    block["t_ns"] = START_NS + number * (10**9 // rate_Hz)
    block["torque_Nm"] = np.sin(number * 1e-3)
    block["brake_temperature_C"] = np.nan
    block["encoder_count"] = -number
    return block


def taken(decimator, block, size):
    return [decimator.take(block[i : i + size]) for i in range(0, len(block), size)]


@pytest.mark.parametrize("size", [1, 7, 200, 333, 10_000])
def test_however_the_blocks_are_cut_the_intervals_are_the_same(size):
    block = ticks(1000 if size == 1 else 10_000)
    parts = taken(Decimator(200), block, size)
    counts = np.concatenate([part.counts for part in parts])
    assert len(counts) == len(block) // 200 - 1  # the last one goes on
    assert (np.diff(counts[:, 0]) == 20_000_000).all()
    assert counts[:, 2].tolist() == [200] * len(counts)
    last = np.concatenate([part.ticks for part in parts])
    assert last["tick"].tolist() == list(range(199, len(block) - 200, 200))
    assert counts[:, 3].tolist() == [0] * len(counts)
    low = np.concatenate([part.minima for part in parts])
    high = np.concatenate([part.maxima for part in parts])
    whole = block["torque_Nm"].reshape(-1, 200)[:-1]
    assert (low["torque_Nm"] == whole.min(axis=1)).all()
    assert (high["torque_Nm"] == whole.max(axis=1)).all()
    assert (low["encoder_count"] == low["tick"].astype(int) * -1 - 199).all()


def test_a_spike_of_one_tick_is_in_the_extremes_and_nan_hides_nothing():
    block = ticks(1000)
    block["i_a_A"][437] = 42.0
    block["i_b_A"][437] = -42.0
    block["u_bus_V"][400:599] = np.nan
    block["u_bus_V"][599] = 48.0
    out = Decimator(200).take(block)
    assert out.ticks["i_a_A"].tolist() == [0, 0, 0, 0]
    assert out.maxima["i_a_A"].tolist() == [0, 0, 42, 0]
    assert out.minima["i_b_A"].tolist() == [0, 0, -42, 0]
    assert out.maxima["u_bus_V"].tolist() == [0, 0, 48, 0]
    assert np.isnan(out.maxima["brake_temperature_C"]).all()


def test_of_bits_the_minimum_is_what_was_always_set_and_the_maximum_what_ever_was():
    block = ticks(400)
    block["flags"] = 0b0110
    block["flags"][10] = 0b1100
    out = Decimator(200).take(block)
    assert (out.minima["flags"].tolist(), out.maxima["flags"].tolist()) == ([0b0100], [0b1110])


def test_what_did_not_arrive_is_counted_and_what_the_loop_skipped_is_not():
    decimator = Decimator(200)
    block = ticks(2000)
    block["missed"][500:] = 20
    block["tick"][500:] += 20
    decimator.take(block[:600])
    assert decimator.lost == 0
    decimator.skip(block[600:700])
    decimator.take(block[800:])
    assert decimator.lost == 100
    decimator.take(np.concatenate([ticks(10), ticks(10, first=15)]))
    assert decimator.lost == 105  # another loop: what is missing of its beginning is not known
    decimator.take(ticks(10, first=26))
    assert decimator.lost == 106


def test_ticks_of_a_silent_bridge_which_all_have_one_time_come_as_ever():
    block = ticks(1000)
    block["t_ns"] = START_NS
    parts = taken(Decimator(200), block, 50)
    assert [count[2] for part in parts for count in part.counts.tolist()] == [200] * 4


def test_nothing_comes_of_nothing():
    assert len(Decimator(200).take(ticks(0)).ticks) == 0
    assert Decimator(200).take(ticks(1)).messages() == ([], [])


def test_messages_are_read_by_their_descriptor():
    rng = np.random.default_rng(5)
    block = ticks(600)
    for field in TICK.fields:
        if field.kind == "float":
            block[field.name] = rng.normal(size=600)
        elif field.kind == "sfixed32":
            block[field.name] = rng.integers(-(2**31), 2**31, 600)
    out = Decimator(200).take(block)
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(extremes_descriptor_set()).file:
        pool.Add(file)
    extremes = message_factory.GetMessageClass(pool.FindMessageTypeByName(EXTREMES_NAME))
    tick = message_factory.GetMessageClass(pool.FindMessageTypeByName("motord.Tick"))
    for i, (last, both) in enumerate(zip(*out.messages(), strict=True)):
        read = extremes.FromString(both)
        assert [read.t_ns, read.t_start_ns, read.ticks, read.lost] == out.counts[i].tolist()
        for message, row in (
            (tick.FromString(last), out.ticks[i]),
            (read.min, out.minima[i]),
            (read.max, out.maxima[i]),
        ):
            for field in TICK.fields:
                np.testing.assert_equal(getattr(message, field.name), row[field.name].item())
