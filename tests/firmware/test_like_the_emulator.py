"""The firmware answers as the emulated board does, against which motord's drivers are tested."""

from hypothesis import given, settings
from hypothesis import strategies as st

from motord.config import load
from motord.emulate.board import Board
from motord.schema import BridgeStatus
from motord.wire.bridge import frames
from tests.firmware.device import Device
from tests.firmware.library import Library
from tests.unit.emulate.benches import EMULATED

CONFIG = load(EMULATED)
LINE = BridgeStatus.ENABLE_LINE | BridgeStatus.HEARTBEAT_LOST
SAYS = st.one_of(
    st.builds(frames.Heartbeat, st.sampled_from([0, 1, 1, 1, 2, 3])),
    st.just(frames.HelloRequest(frames.PROTOCOL)),
    st.builds(
        frames.Configure,
        st.integers(100, 20_000) | st.sampled_from([0, 99, 20_001]),
        st.integers(1000, 10_000) | st.sampled_from([0, 999, 1_000_000, 1_000_001]),
    ),
    st.just(frames.Start()),
    st.just(frames.Stop()),
)


class Twins:
    """Both boards, with the same requests."""

    def __init__(self, library: Library) -> None:
        self.device = Device(library)
        self.board = Board(CONFIG, reset_ns=0)
        self.device.answers()
        self.say(frames.Configure(1000, 5000))

    def say(self, frame: frames.Frame, step: int = 0) -> None:
        """Send a frame; `step`: by how much its number differs from the next one's."""
        now_ns = self.device.now_us * 1000
        number = self.device.sequence = (self.device.sequence + step) % frames.SEQUENCE_MODULUS
        self.device.send(frame)
        self.board.expire(now_ns)
        answers = self.board.receive(now_ns, frames.Numbered(number, frame))
        ours = self.device.answers()
        assert [type(answer) for answer in ours] == [type(answer) for answer in answers]
        for answer, wanted in zip(ours, answers, strict=True):
            assert comparable(answer) == comparable(wanted)

    def settle(self) -> None:
        """Judge both lines at this instant, not at the last tick, and compare them."""
        self.device.tick()
        self.device.answers()
        self.board.expire(self.device.now_us * 1000)
        assert self.device.closed == self.board.line_closed

    def let_pass(self, time_us: int) -> None:
        self.device.pass_us(time_us)
        self.device.answers()  # samples, and Status now and then


def comparable(frame: frames.Frame) -> tuple[object, ...]:
    """Return what of an answer does not depend on the board's clock and name."""
    if isinstance(frame, frames.Hello):
        return frame.protocol, frame.counts, frame.layout, frame.heartbeat_next
    assert isinstance(frame, frames.Status)
    beat = frame.heartbeats, frame.heartbeat_sequence
    return frame.rate_Hz, frame.streaming, frame.errors, *beat, int(frame.status & LINE)


STEPS = st.sampled_from([0, 0, 0, 0, 1, 5, -1, -2, -10, 32_767, 32_768, 32_769])


@given(st.lists(st.tuples(SAYS, STEPS, st.integers(0, 8) | st.just(30)), max_size=40))
@settings(max_examples=200)
def test_the_same_answers_and_the_same_line(
    library: Library, story: list[tuple[frames.Frame, int, int]]
) -> None:
    twins = Twins(library)
    for frame, step, quarters in story:
        twins.say(frame, step)
        twins.settle()
        twins.let_pass(quarters * 625)
        twins.settle()
