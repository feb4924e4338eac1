import os

import pytest
import serial

from motord import config
from motord.emulate.board import Board
from motord.emulate.bridge.link import BoardLink
from motord.wire.bridge import frames
from motord.wire.bridge.stream import StreamDecoder
from motord.wire.sequence import SequenceCheck
from tests.unit.emulate.benches import EMULATED


@pytest.fixture
def ends(tmp_path):
    check = SequenceCheck(frames.SEQUENCE_MODULUS)
    link = BoardLink(tmp_path / "port", check)
    with serial.Serial(str(tmp_path / "port"), timeout=60) as host:
        yield link, host, check
    link.close()


def test_frames_go_out_numbered(ends):
    link, host, _ = ends
    sent = [frames.Sample(n, n, -n, 0) for n in range(3)]
    assert all(link.send(sample) for sample in sent)
    decoder, got = StreamDecoder(), []
    while len(got) < 3:
        got += decoder.feed(os.read(host.fileno(), 4096))
    assert got == [frames.Numbered(n, sample) for n, sample in enumerate(sent)]
    assert link.pty_name.startswith("/dev/pts/")


def test_frames_that_waited_are_spread_over_the_wait(ends):
    link, host, _ = ends
    assert list(link.receive(1000)) == []
    host.write(b"".join(frames.encode(frames.Heartbeat(1), n) for n in range(4)))
    host.flush()
    assert [(t, f.sequence) for t, f in link.receive(5000)] == [
        (2000, 0),
        (3000, 1),
        (4000, 2),
        (5000, 3),
    ]
    host.write(frames.encode(frames.Heartbeat(1), 4))
    assert [t for t, _ in link.receive(6000)] == [6000]


def test_noise_is_counted(ends):
    link, host, check = ends
    host.write(b"noise\0")
    assert list(link.receive(1)) == []
    assert check.errors == 1


def test_faults_on_the_line(ends):
    link, host, _ = ends
    link.faults.active, link.faults.delay_ns = True, 5
    assert link.send(frames.Sample(1, 1, 1, 0), 10)
    link.faults.clear()
    link.faults.active, link.faults.drop = True, 1.0
    link.send(frames.Sample(2, 2, 2, 0), 11)
    host.write(frames.encode(frames.Heartbeat(1), 0))
    host.flush()
    assert list(link.receive(1)) == []
    link.faults.clear()
    link.play(15)
    link.send(frames.Sample(3, 3, 3, 0), 16)
    decoder, got = StreamDecoder(), []
    while len(got) < 2:
        got += decoder.feed(os.read(host.fileno(), 4096))
    assert [(n.sequence, n.frame.t_us) for n in got] == [(0, 1), (2, 3)]
    board = Board(config.load(EMULATED), 0)
    link.greet(board)
    [anew] = StreamDecoder().feed(os.read(host.fileno(), 4096))
    assert (anew.sequence, anew.frame.layout) == (0, frames.LAYOUT_HASH)
