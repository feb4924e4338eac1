"""Telemetry: every tick once, decimation, and a slow network that holds up nobody."""

import threading

import numpy as np

from motord.schema import TICK, TICK_DTYPE
from motord.service.publish import telemetry
from motord.service.publish.telemetry import Telemetry
from motord.wire.ticks.blocks import BlockCodec
from tests.support.panic import panic

CODEC = BlockCodec(TICK)


class Network:
    """Keeps what is put; `may_put` holds a put up."""

    def __init__(self):
        self.puts = []
        self.may_put = threading.Event()
        self.may_put.set()
        self.entered = threading.Event()

    def put(self, name, payload):
        self.entered.set()
        assert self.may_put.wait(30)
        self.puts.append((name, payload))

    def of(self, name):
        return [payload for key, payload in self.puts if key == name]


def ticks(first, count):
    block = np.zeros(count, TICK_DTYPE)
    block["tick"] = np.arange(first, first + count)
    block["torque_Nm"] = 0.5
    return block


def test_every_tick_goes_out_once_in_blocks_and_every_tenth_alone():
    network = Network()
    out = Telemetry(network.put, rate_Hz=1000, tick_rate_Hz=100, block_s=0.05)
    out.start()
    for first in range(0, 120, 8):
        out.ticks(ticks(first, 8))
    out.ticks(ticks(0, 0))
    out.json("state", b"{}")
    out.stop()
    blocks = [CODEC.decode_list(payload) for payload in network.of("ticks")]
    assert np.array_equal(np.concatenate(blocks)["tick"], np.arange(120))
    assert [len(block) for block in blocks] == [56, 56, 8]
    alone = [CODEC.decode(payload) for payload in network.of("tick")]
    assert [int(tick["tick"][0]) for tick in alone] == list(range(0, 120, 10))
    assert network.of("state") == [b"{}"]
    assert out.dropped == 0


def test_a_network_that_stands_still_holds_up_nobody_and_the_loss_is_counted():
    network = Network()
    network.may_put.clear()
    out = Telemetry(network.put, rate_Hz=1000, tick_rate_Hz=100, block_s=0.05)
    out.start()
    out.json("first", b"")
    assert network.entered.wait(10)
    for number in range(telemetry.CAPACITY + 10):
        out.json("event", str(number).encode())
    assert out.dropped == 10
    network.may_put.set()
    out.stop()
    numbers = [int(payload) for payload in network.of("event")]
    assert numbers == list(range(10, telemetry.CAPACITY + 10))


def test_a_panic_of_zenoh_is_logged_and_the_next_goes_out(caplog):
    network, puts = Network(), []

    def put(name, payload):
        puts.append(name)
        if name == "first":
            panic()
        network.put(name, payload)

    out = Telemetry(put, rate_Hz=1000, tick_rate_Hz=100, block_s=0.05)
    out.start()
    for name in ("first", "second"):
        out.json(name, b"{}")
    out.stop()
    assert (puts, network.of("second"), out.dropped) == (["first", "second"], [b"{}"], 1)
    assert "in the telemetry: PanicError: of a library in Rust" in caplog.text
