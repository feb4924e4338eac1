import itertools
import time
from pathlib import Path

import can
import pytest

from motord import config
from motord.config.devices import BridgeCanConfig
from motord.emulate import EmulatorError
from motord.emulate.board import Board
from motord.emulate.bridge.can_link import BoardCanLink
from motord.emulate.clock import HostClock
from motord.emulate.control import control_path
from motord.emulate.process import Emulator
from motord.rig import truth as rig_truth
from motord.wire.bridge import frames
from motord.wire.bridge.segmentation import PieceDecoder, split
from motord.wire.can.frame_format import CLASSIC_BYTES, FD_BYTES
from motord.wire.sequence import SequenceCheck
from tests.unit.emulate.benches import EMULATED, write_bench

CHANNEL = "test-can-link"


@pytest.fixture(params=[False, True], ids=["classic", "fd"])
def ends(request):
    settings = BridgeCanConfig(interface="virtual", channel=CHANNEL, fd=request.param)
    link = BoardCanLink(settings, HostClock(), SequenceCheck(frames.SEQUENCE_MODULUS))
    with can.Bus(CHANNEL, "virtual", fd=request.param, ignore_config=True) as host:
        yield link, host, FD_BYTES if request.param else CLASSIC_BYTES
    link.close()


def say(host, frame, number, size, identifier=0x110):
    """Send a frame from the host; each has one piece."""
    for piece in split(frames.pack(frame, number), number, size):
        host.send(
            can.Message(
                arbitration_id=identifier, is_extended_id=False, is_fd=size == FD_BYTES, data=piece
            )
        )


def received(host):
    decoder, found = PieceDecoder(), []
    while (message := host.recv(0)) is not None:
        assert message.arbitration_id == 0x190
        found.append(decoder.feed(bytes(message.data)))
    return [numbered for numbered in found if numbered is not None], decoder.errors


def test_frames_go_out_in_pieces(ends):
    link, host, _ = ends
    sent = [frames.Sample(n, n, -n, 0) for n in range(40)]
    assert all(link.send(sample) for sample in sent)
    assert received(host) == ([frames.Numbered(n, sample) for n, sample in enumerate(sent)], 0)
    assert link.pty_name == ""


def test_frames_of_the_host_come_with_their_times(ends):
    link, host, size = ends
    before_ns = time.monotonic_ns()
    say(host, frames.Heartbeat(1), 0, size)
    say(host, frames.Heartbeat(0), 1, size)
    say(host, frames.Heartbeat(1), 2, size, identifier=0x111)
    now_ns = time.monotonic_ns()
    got = list(link.receive(now_ns))
    assert [numbered.frame.enable for _, numbered in got] == [1, 0]
    assert all(before_ns - 1e9 < at_ns <= now_ns for at_ns, _ in got)
    assert list(link.receive(now_ns)) == []


def test_faults_on_the_wire(ends):
    link, host, size = ends
    link.faults.active, link.faults.delay_ns = True, 5
    assert link.send(frames.Sample(1, 1, 1, 0), 10)
    link.faults.clear()
    link.faults.active, link.faults.drop = True, 1.0
    say(host, frames.Heartbeat(1), 0, size)
    assert list(link.receive(1)) == []
    assert received(host) == ([], 0)
    link.play(20)
    assert [numbered.frame.t_us for numbered in received(host)[0]] == [1]


@pytest.mark.parametrize(("refused", "numbers"), [(range(9), [0]), (range(1), [1])])
def test_a_frame_without_room_is_missed_once_by_the_board_or_the_host(
    ends, monkeypatch, refused, numbers
):
    link, host, size = ends
    if size == FD_BYTES and len(refused) == 1:
        numbers = [0]  # it is all of the frame
    send, count = link._bus._bus.send, itertools.count()

    def full(message, timeout):
        if next(count) in refused:
            raise can.CanOperationError("no room")
        send(message, timeout)

    with monkeypatch.context() as patch:
        patch.setattr(link._bus._bus, "send", full)
        missed = not link.send(frames.Sample(1, 1, 1, 0))
    assert link.send(frames.Sample(2, 2, 2, 0))
    found, errors = received(host)
    assert [numbered.sequence for numbered in found] == numbers
    assert missed + errors == 1


def test_greeting_numbers_frames_anew(ends):
    link, host, _ = ends
    link.send(frames.Sample(1, 1, 1, 0))
    link.greet(Board(config.load(EMULATED), 0))
    first, hello = received(host)[0]
    assert (first.sequence, hello.sequence) == (0, 0)
    assert hello.frame.board_name == "motord-emulate"


def bench(path=EMULATED, **can_):
    whole = config.load(path)
    bridge = whole.bridge.model_copy(
        update={"driver": "can", "can": BridgeCanConfig(interface="virtual", **can_)}
    )
    return whole.model_copy(update={"bridge": bridge})


def test_control_socket_of_a_bench_without_a_port():
    assert control_path(bench(channel="a")) == control_path(bench(channel="a"))
    assert control_path(bench(channel="a")) != control_path(bench(channel="b"))


def test_firmware_in_qemu_is_not_on_can(tmp_path):
    whole = bench(write_bench(tmp_path), channel="b")
    emulated = Emulator(whole, rig_truth.load(whole.bench.rig), firmware=Path("nothing.elf"))
    with pytest.raises(EmulatorError, match="serial line only"), emulated:
        pass
