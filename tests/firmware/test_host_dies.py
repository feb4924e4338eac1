"""However the host dies, the enable line is open one heartbeat timeout and 1 ms later.

Time is the firmware's. The main loop never runs after the host has died, and often the link is
full: neither matters to the line.
"""

import random
from collections.abc import Callable, Iterator

import pytest

from motord.wire.bridge import frames
from tests.firmware.device import CLOCK, Device
from tests.firmware.library import Library

TIMEOUT_US = 5_000
BEAT_US = 1_000
ALIVE_BEATS = 120
STEP_US = 100
Death = Callable[[Device, list[bytes]], Iterator[list[bytes]]]
"""Given the board and what the host sent while it lived, what comes in at every step of 100 us."""


def silence(device: Device, sent: list[bytes]) -> Iterator[list[bytes]]:
    while True:
        yield []


def noise(device: Device, sent: list[bytes]) -> Iterator[list[bytes]]:
    draw = random.Random(1)
    while True:
        yield [draw.randbytes(draw.randint(0, 8)) for _ in range(3)]


def zeros(device: Device, sent: list[bytes]) -> Iterator[list[bytes]]:
    while True:
        yield [bytes(8)]


def last_frame_again_and_again(device: Device, sent: list[bytes]) -> Iterator[list[bytes]]:
    while True:
        yield [sent[-1]]


def a_buffer_again_and_again(frames_in_it: int) -> Death:
    def death(device: Device, sent: list[bytes]) -> Iterator[list[bytes]]:
        at = 0
        while True:
            yield [sent[at % frames_in_it - frames_in_it]]
            at += 1

    death.__name__ = f"the_last_{frames_in_it}_again_and_again"
    return death


def in_the_middle_of_a_frame(device: Device, sent: list[bytes]) -> Iterator[list[bytes]]:
    yield [device.wire(frames.Heartbeat(1))[0][:4]]
    yield from silence(device, sent)


def corrupt_heartbeats(device: Device, sent: list[bytes]) -> Iterator[list[bytes]]:
    while True:
        whole = device.wire(frames.Heartbeat(1))[0]
        yield [whole[:2] + bytes((whole[2] ^ 0x21,)) + whole[3:]]


def torn_heartbeats(device: Device, sent: list[bytes]) -> Iterator[list[bytes]]:
    while True:
        whole = device.wire(frames.Heartbeat(1))[0]
        yield [whole[:3] + whole[4:]]


def every(*contents: frames.Frame) -> Death:
    """Make a host of which a part lives: it still sends these, in good order, but no heartbeat."""

    def death(device: Device, sent: list[bytes]) -> Iterator[list[bytes]]:
        while True:
            yield [data for frame in contents for data in device.wire(frame)]

    death.__name__ = "only_" + "_".join(type(frame).__name__ for frame in contents)
    return death


def an_echo_of_the_board(device: Device, sent: list[bytes]) -> Iterator[list[bytes]]:
    status = frames.Status(1, 1, 1, 1, 1, 1, 1, 1, 1, 1)
    while True:
        yield device.wire(frames.Sample(0, 0, 0, 1)) + device.wire(status)


DEATHS: list[Death] = [
    silence,
    noise,
    zeros,
    last_frame_again_and_again,
    a_buffer_again_and_again(2),
    a_buffer_again_and_again(7),
    a_buffer_again_and_again(100),
    a_buffer_again_and_again(ALIVE_BEATS),  # with heartbeats in it that ask for an open line
    in_the_middle_of_a_frame,
    corrupt_heartbeats,
    torn_heartbeats,
    every(frames.Start()),
    every(frames.HelloRequest(frames.PROTOCOL)),
    every(frames.Configure(1000, TIMEOUT_US)),
    every(frames.Configure(99, 1_000_000), frames.Configure(1000, 20_000_000)),
    an_echo_of_the_board,
]


def alive(device: Device) -> list[bytes]:
    """Let a host live: heartbeats, first without then with the request to close the line."""
    sent = []
    for number in range(ALIVE_BEATS):
        sent += device.wire(frames.Heartbeat(int(number > 10)))
        device.receive(sent[-1])
        device.lib.bridge_poll(device.bridge)
        assert device.closed == (number > 10)
        if number < ALIVE_BEATS - 1:
            device.pass_us(BEAT_US)
    return sent


@pytest.mark.parametrize("rate_Hz", [100, 1999, 20_000])
@pytest.mark.parametrize("link", [0, 1])
@pytest.mark.parametrize("death", DEATHS, ids=lambda death: death.__name__)
@pytest.mark.parametrize("full", [False, True], ids=["link_free", "link_full"])
def test_the_line_opens_in_time_and_stays_open(
    library: Library, death: Death, link: int, rate_Hz: int, full: bool
) -> None:
    before_wrap_us = random.Random(rate_Hz).randrange(1, ALIVE_BEATS * BEAT_US + TIMEOUT_US)
    device = Device(library, link, CLOCK - before_wrap_us)
    device.ask(frames.Configure(rate_Hz, TIMEOUT_US))
    device.send(frames.Start())
    if full:
        device.host.room = 0
    sent = alive(device)
    died_us, opened_us = device.now_us, None
    for incoming in death(device, sent):
        for data in incoming:
            device.receive(data)
        device.pass_us(STEP_US)
        if opened_us is None and not device.closed:
            opened_us = device.now_us  # up to a step after it opened
        if opened_us is not None:
            assert not device.closed
        if device.now_us - died_us > 6 * TIMEOUT_US:
            break
    assert opened_us is not None
    assert opened_us - died_us <= TIMEOUT_US + 1000
    asked_to = death.__name__ in (f"the_last_{ALIVE_BEATS}_again_and_again", "only_Configure")
    assert asked_to or opened_us - died_us >= TIMEOUT_US


def test_a_host_that_comes_back_has_to_ask_for_an_open_line_first(library: Library) -> None:
    device = Device(library)
    alive(device)
    device.pass_us(60_000)
    for _ in range(5):
        device.beat(1)
        device.pass_us(BEAT_US)
        assert not device.closed
    device.beat(0)
    device.beat(1)
    assert device.closed


def test_a_stop_that_is_lost_is_made_good_by_the_silence_after_it(library: Library) -> None:
    device = Device(library)
    alive(device)
    device.wire(frames.Stop())
    device.pass_us(51_000)
    assert not device.closed


def test_the_line_opens_at_once_when_asked(library: Library) -> None:
    """Whatever number the frame has; but only a new one lets the next heartbeat close it again."""
    for frame in (frames.Stop(), frames.Heartbeat(0), frames.HelloRequest(9)):
        for sequence in (None, 0, 15, ALIVE_BEATS - 1):
            device = Device(library)
            alive(device)
            device.send(frame, sequence)
            assert not device.closed
            device.send(frames.Heartbeat(1), 16)
            assert not device.closed
            device.beat(1)
            assert device.closed == (type(frame) is frames.Heartbeat and sequence is None)
            device.close_line()
            assert device.closed == (type(frame) is not frames.HelloRequest)


def test_a_repeated_heartbeat_does_not_spoil_the_one_before_it(library: Library) -> None:
    device = Device(library)
    device.beat(0)
    device.send(frames.Heartbeat(0), device.sequence - 1)
    device.beat(1)
    assert device.closed


def test_an_old_heartbeat_does_not_let_the_line_close(library: Library) -> None:
    device = Device(library)
    alive(device)
    device.send(frames.Stop())
    device.send(frames.Heartbeat(0), 3)
    device.beat(1)
    assert not device.closed


@pytest.mark.parametrize("link", [0, 1])
def test_after_a_reset_in_mid_run_the_line_stays_open(library: Library, link: int) -> None:
    """The host does not know of it and still asks for a closed line."""
    before = Device(library, link)
    alive(before)
    device = Device(library, link, before.now_us)
    assert not device.closed
    device.sequence = before.sequence
    for _ in range(200):
        device.beat(1)
        device.pass_us(BEAT_US)
        assert not device.closed
    device.close_line()
    assert device.closed


def test_after_stop_the_line_stays_open(library: Library) -> None:
    device = Device(library)
    alive(device)
    device.send(frames.Stop())
    for _ in range(200):
        device.beat(1)
        device.pass_us(BEAT_US)
        assert not device.closed
    device.close_line()
    assert device.closed


@pytest.mark.parametrize("late_us", [-1, 0])
def test_both_sides_of_the_edge(library: Library, late_us: int) -> None:
    """A heartbeat one microsecond before the timeout counts, one on it does not."""
    device = Device(library, now_us=CLOCK - 70_000)
    device.close_line()
    device.now_us += 50_000 + late_us
    device.beat(1)
    assert device.closed == (late_us < 0)
    device.tick()
    assert device.closed == (late_us < 0)


def test_a_new_host_goes_on_from_the_number_in_hello(library: Library) -> None:
    device = Device(library)
    alive(device)
    device.sequence = 0
    hello = device.ask(frames.HelloRequest(frames.PROTOCOL))
    assert isinstance(hello, frames.Hello)
    assert hello.heartbeat_next == ALIVE_BEATS
    for _ in range(3):
        device.send(frames.Heartbeat(0), 5)
        device.send(frames.Heartbeat(1), 6)
        device.pass_us(1000)
    assert not device.closed
    device.sequence = hello.heartbeat_next
    device.close_line()
    assert device.closed


@pytest.mark.parametrize("turns", [0, 1, 126, 127])
def test_numbers_go_on_when_the_sequence_wraps(library: Library, turns: int) -> None:
    """Frames of the turn before, of half of all turns before, are old; the next is new."""
    device = Device(library)
    device.send(frames.Heartbeat(turns << 1), 65_535)
    device.send(frames.Heartbeat((turns + 1) % 128 << 1 | 1), 0)
    assert device.closed
    device.pass_us(49_000)
    for back in (0, 1, 5, 63):
        device.send(frames.Heartbeat((turns - back) % 128 << 1 | 1), 65_000)
        device.send(frames.Heartbeat((turns - back) % 128 << 1 | 1), 5)
    device.pass_us(2000)
    assert not device.closed
    assert device.bridge.heartbeats == 2


@pytest.mark.parametrize(
    "frame", [frames.Start(), frames.Configure(500, 9000), frames.Heartbeat(1)]
)
def test_an_old_command_does_nothing(library: Library, frame: frames.Frame) -> None:
    device = Device(library)
    alive(device)
    device.answers()
    device.send(frame, 30)
    assert device.closed
    assert not device.answers()
    assert (device.bridge.heartbeats, device.bridge.streaming) == (ALIVE_BEATS, False)
    assert device.bridge.rate_Hz == 1000


def test_old_frames_are_no_signs_of_life(library: Library) -> None:
    """Not even to the count of the silence: they come without end."""
    device = Device(library)
    sent = alive(device)
    for _ in range(3):
        for old in sent:
            device.receive(old)
            device.pass_us(10_000)
            assert not device.closed
    assert device.bridge.heartbeats == ALIVE_BEATS


def test_configure_opens_the_line_and_prolongs_nothing(library: Library) -> None:
    """An old one, too, to which a HelloRequest before it lends a number that is taken."""
    for silent_us, state in ((49_999, "LINE_SILENT"), (50_000, "LINE_LOST")):
        device = Device(library)
        device.close_line()
        device.now_us += silent_us
        device.send(frames.HelloRequest(frames.PROTOCOL), 0)
        device.send(frames.Configure(1000, 1_000_000), 1)
        assert not device.closed
        assert device.bridge.line.state == getattr(device.lib, state)
        assert device.bridge.line.timeout_us == 1_000_000
