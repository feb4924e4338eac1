"""Ticks in C and JavaScript, from the .proto file alone.

The payloads are those that a daemon publishes, byte for byte, and in JavaScript those of its own
session of Zenoh; every field of every tick has the value that Python decodes.
"""

import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
import zenoh

from motord.api.endpoints import client_config, key
from motord.client import connect
from motord.proto import FOLDER
from motord.schema import TICK, TICK_DTYPE
from motord.wire.ticks.blocks import BlockCodec
from tests.support.patience import PATIENCE_S, until
from tests.unit.service.live_service import live_service

TESTS = Path(__file__).resolve().parents[1]
PROTO = FOLDER / "tick.proto"
CODEC = BlockCodec(TICK)
BLOCKS = 3

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc: apt-get install gcc")
needs_node = pytest.mark.skipif(
    shutil.which("node") is None or not (TESTS / "node" / "node_modules").exists(),
    reason="needs node and packages: apt-get install nodejs npm, npm ci --prefix tests/node",
)


@pytest.fixture(scope="module")
def c_decoder(tmp_path_factory):
    program = tmp_path_factory.mktemp("c") / "decode"
    flags = ["-std=c11", "-O1", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    subprocess.run(["gcc", *flags, "-o", program, TESTS / "languages" / "decode.c"], check=True)
    return [str(program)]


@pytest.fixture(params=[pytest.param("c", marks=needs_gcc), pytest.param("js", marks=needs_node)])
def decoder(request):
    if request.param == "c":
        return request.getfixturevalue("c_decoder")
    return ["node", str(TESTS / "node" / "decode.mjs")]


@pytest.fixture(scope="module")
def published(tmp_path_factory):
    """Payloads of `tick` and `ticks` as they arrive at a subscriber."""
    got = {"tick": [], "ticks": []}
    with (
        live_service(tmp_path_factory.mktemp("state")) as live,
        zenoh.open(client_config(live.listen)) as session,
    ):
        for name, payloads in got.items():
            with session.declare_subscriber(key("live", name)) as subscriber:
                while len(payloads) < BLOCKS:
                    payloads.append(subscriber.recv().payload.to_bytes())
    return got


def framed(kind, payload):
    return kind.encode() + struct.pack("<I", len(payload)) + payload


def output(command, data=None):
    """Return the lines that a program prints."""
    done = subprocess.run(command, input=data, capture_output=True, check=False, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    return done.stdout.decode().splitlines()


def values(line):
    """Return the values of a tick by name, as text."""
    return dict(item.split("=") for item in line.split(" "))


def decoded(command, data):
    """Return what a decoder prints of each tick."""
    return [values(line) for line in output([*command, str(PROTO)], data)]


def compare(found, block):
    assert len(found) == len(block)
    for texts, row in zip(found, block, strict=True):
        assert list(texts) == [field.name for field in TICK.fields]
        for field in TICK.fields:
            dtype = TICK_DTYPE[field.name]
            value = texts[field.name].replace("Infinity", "inf")
            read = dtype.type(float(value)) if dtype.kind == "f" else int(value)
            np.testing.assert_equal(read, row[field.name].item(), err_msg=field.name)


def extremes():
    """Ticks with the limits of every type, zero, and what is no number."""
    block = np.zeros(6, TICK_DTYPE)
    for field in TICK.fields:
        dtype = TICK_DTYPE[field.name]
        if dtype.kind == "f":
            info = np.finfo(dtype)
            block[field.name] = [info.min, info.max, np.nan, np.inf, -np.inf, info.smallest_normal]
        else:
            info = np.iinfo(dtype)
            block[field.name] = [info.min, info.max, 0, 1, info.max - 1, info.max // 3]
    return block


def test_what_the_daemon_publishes(decoder, published):
    payloads = [("t", p) for p in published["tick"]] + [("b", p) for p in published["ticks"]]
    block = np.concatenate(
        [CODEC.decode(p) for p in published["tick"]]
        + [CODEC.decode_list(p) for p in published["ticks"]]
    )
    assert len(block) > 100
    compare(decoded(decoder, b"".join(framed(*one) for one in payloads)), block)


def test_extremes_negative_numbers_and_nan(decoder):
    block = extremes()
    data = b"".join(framed("t", row.tobytes()) for row in CODEC.encode(block))
    compare(decoded(decoder, data + framed("b", CODEC.encode_list(block))), [*block, *block])


def test_a_field_that_is_not_written_is_zero(decoder):
    """proto3 leaves zeros out: a message of google.protobuf has none of them."""
    assert decoded(decoder, framed("t", b""))[0].keys() == {f.name for f in TICK.fields}
    assert set(decoded(decoder, framed("t", b""))[0].values()) == {"0"}


@needs_node
@pytest.mark.parametrize("batch_size", [65535, 16384])
def test_a_session_of_zenoh_in_javascript(tmp_path, batch_size):
    """With small batches the blocks come in fragments."""
    blocks = []
    program = ["node", str(TESTS / "node" / "subscribe.mjs"), "127.0.0.1"]
    with (
        live_service(tmp_path) as live,
        connect("live", live.listen) as client,
        client.subscribe_ticks(blocks.append),
    ):
        until(lambda: blocks)  # from its first tick on they are here, too
        port = live.listen.rpartition(":")[2]
        lines = output([*program, port, "live", str(PROTO), "200", str(batch_size)])
        pairs = [line.split(" ", 1) for line in lines]
        newest = max(int(values(text)["tick"]) for _, text in pairs)
        until(lambda: blocks[-1]["tick"][-1] >= newest)
    rows = {int(row["tick"]): row for row in np.concatenate(blocks)}
    for name, least in (("tick", 1), ("ticks", 100)):
        found = [values(text) for topic, text in pairs if topic == key("live", name)]
        both = [one for one in found if int(one["tick"]) in rows]  # a busy computer drops some
        assert len(both) >= least
        compare(both, [rows[int(one["tick"])] for one in both])
