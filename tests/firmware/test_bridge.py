"""The whole board behind its link: commands and answers, samples, overflow, watchdog."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.schema import BridgeStatus
from motord.wire.bridge import frames
from tests.firmware.device import CLOCK, Device
from tests.firmware.library import Library
from tests.support.properties import examples

LINKS = pytest.mark.parametrize("link", [0, 1, 2])
SECOND_US = 1_000_000
TICK_US = 500  # unless configured


def samples(answers: list[frames.Frame]) -> list[frames.Sample]:
    return [frame for frame in answers if isinstance(frame, frames.Sample)]


def statuses(answers: list[frames.Frame]) -> list[frames.Status]:
    return [frame for frame in answers if isinstance(frame, frames.Status)]


def streaming(library: Library, rate_Hz: int = 1000, link: int = 0, now_us: int = 0) -> Device:
    device = Device(library, link, now_us)
    device.ask(frames.Configure(rate_Hz, 50_000))
    device.pass_us(20_000)  # the encoder is found
    device.ask(frames.Start())
    return device


def collect(device: Device, time_us: int, lines: int = 0) -> list[frames.Frame]:
    """Let time pass with a main loop that comes round every 5 ms; return what was sent."""
    got = []
    for _ in range(time_us // 5000):
        device.pass_us(5000, lines)
        got += device.answers()
    return got


@LINKS
def test_hello_after_reset_and_when_asked(library: Library, link: int) -> None:
    device = Device(library, link)
    (hello,) = device.answers()
    assert hello == frames.Hello(
        protocol=frames.PROTOCOL,
        firmware=frames.firmware(1, 3, 0),
        board=b"host".ljust(16, b"\0"),
        serial=7,
        rate_Hz=1000,
        counts=4096,
        layout=frames.LAYOUT_HASH,
    )
    assert device.ask(frames.HelloRequest(frames.PROTOCOL)) == hello
    assert device.link_errors == 0


def test_a_long_name_is_cut(library: Library) -> None:
    name = library.ffi.new("char[]", b"a board of many words")
    device = Device(library, name=name)
    (hello,) = device.answers()
    assert isinstance(hello, frames.Hello)
    assert hello.board == b"a board of many "


def test_the_line_is_open_from_the_first(library: Library) -> None:
    """The board's memory holds a closed line; the core opens it before anything else."""
    assert not Device(library).closed


@LINKS
def test_start_stream_stop(library: Library, link: int) -> None:
    device = Device(library, link)
    assert not samples(collect(device, 50_000))
    status = device.ask(frames.Start())
    assert isinstance(status, frames.Status)
    assert (status.streaming, status.rate_Hz) == (1, 1000)
    got = collect(device, SECOND_US)
    assert len(samples(got)) == 1000
    assert [frame.t_us for frame in statuses(got)] == [
        status.t_us + 50_000 * n for n in range(1, 21)
    ]
    status = device.ask(frames.Stop())
    assert isinstance(status, frames.Status)
    assert status.streaming == 0
    assert not collect(device, 100_000)
    assert device.link_errors == 0
    assert status.errors == 0


@pytest.mark.parametrize("rate_Hz", [100, 3000, 20_000])
def test_status_comes_twenty_times_a_second_at_any_rate(library: Library, rate_Hz: int) -> None:
    device = streaming(library, rate_Hz)
    got = []
    for _ in range(500):
        device.pass_us(2000)
        got += statuses(device.answers())
    assert len(got) in (19, 20)


@given(st.integers(100, 20_000))
@settings(max_examples=examples(40))
def test_rates(library: Library, rate_Hz: int) -> None:
    """The tick comes at least 2000 times a second, and is a multiple of the rate."""
    device = streaming(library, rate_Hz)
    tick_Hz = device.host.tick_Hz
    assert 2000 <= tick_Hz <= 20_000 or tick_Hz == rate_Hz
    assert tick_Hz % rate_Hz == 0
    assert tick_Hz < 4000 or tick_Hz == rate_Hz
    got = []
    for _ in range(50):
        device.pass_us(2000)
        got += samples(device.answers())
    assert len(got) == pytest.approx(rate_Hz * 0.1, abs=1.5)


@pytest.mark.parametrize("rate_Hz", [100, 500, 1000, 2000, 5000, 10_000, 20_000])
@given(before_us=st.integers(0, 20_000), start_after_us=st.integers(0, 30_000))
@settings(max_examples=examples(20), deadline=None)
def test_samples_are_one_period_apart_from_configure_on(
    library: Library, rate_Hz: int, before_us: int, start_after_us: int
) -> None:
    """The first interval as well, wherever Configure and Start fall into the old rate's period."""
    device = Device(library)
    device.pass_us(before_us)
    configured_us, period_us = device.now_us, 1_000_000 // rate_Hz
    device.send(frames.Configure(rate_Hz, 50_000))
    device.pass_us(start_after_us)
    device.send(frames.Start())
    device.pass_us(8 * period_us)
    t_us = [sample.t_us for sample in samples(device.answers())]
    first = start_after_us // period_us + 1
    assert t_us[:7] == [configured_us + (first + n) * period_us for n in range(7)]


@pytest.mark.parametrize(
    ("rate_Hz", "timeout_us", "taken"),
    [
        (99, 50_000, False),
        (100, 50_000, True),
        (20_000, 50_000, True),
        (20_001, 50_000, False),
        (0, 50_000, False),
        (2**32 - 1, 50_000, False),
        (2000, 0, False),
        (2000, 999, False),
        (2000, 1000, True),
        (2000, 1_000_000, True),
        (2000, 1_000_001, False),
        (2000, 2**32 - 1, False),
    ],
)
def test_configure_takes_all_or_nothing(
    library: Library, rate_Hz: int, timeout_us: int, taken: bool
) -> None:
    device = Device(library)
    status = device.ask(frames.Configure(rate_Hz, timeout_us))
    assert isinstance(status, frames.Status)
    assert status.rate_Hz == (rate_Hz if taken else 1000)
    assert status.heartbeat_timeout_us == (timeout_us if taken else 50_000)
    assert device.bridge.line.timeout_us == (timeout_us if taken else 50_000)


def test_a_boards_own_limits(library: Library) -> None:
    device = Device(library, rate_max_Hz=5000, tick_max_Hz=4000)
    for rate_Hz, reported_Hz in ((5001, 1000), (4500, 1000), (4000, 4000)):
        status = device.ask(frames.Configure(rate_Hz, 20_000))
        assert isinstance(status, frames.Status)
        assert status.rate_Hz == reported_Hz
        assert device.bridge.line.timeout_us == (20_000 if rate_Hz == 4000 else 50_000)


def test_samples_carry_what_was_read_at_one_instant(library: Library) -> None:
    device = streaming(library, now_us=CLOCK - 25_000)
    device.pass_us(3000, 0b1)
    device.now_us += 777
    device.answers()
    for lines, adc in ((0b11, [2049, 2050]), (0b10, [2000])):
        device.tick(0b11, [1, 2, 3])
        device.now_us += 5
        device.tick(lines, adc)
        (sample,) = device.answers()
        assert sample == frames.Sample(
            device.now_us % CLOCK, lines, {0b11: 24, 0b10: -768}[lines], 0
        )


def test_torque_and_encoder_not_valid(library: Library) -> None:
    device = streaming(library)
    torque, encoder = BridgeStatus.TORQUE_INVALID, BridgeStatus.ENCODER_INVALID
    for adc in ([0], [4095], []):
        device.tick()
        device.tick(0, adc)
        assert device.bridge.sample_status == torque
    statuses = []
    for _ in range(20):
        device.tick(0xC00)
        device.tick(0xC00)
        statuses.append(device.bridge.sample_status)
    assert statuses == [0, *[encoder] * 7, *[0] * 12]
    *_, sample = samples(device.answers())
    assert sample.encoder_gray == 0xC00


def test_a_glitch_between_two_samples_is_reported_with_the_second(library: Library) -> None:
    device = streaming(library, 100)  # twenty ticks a sample
    assert device.bridge.ticks_per_sample == 20
    while device.bridge.ticks_to_sample != 20:
        device.tick()
    for _ in range(5):
        device.tick(0xC00)
    for _ in range(15):
        device.tick()
    assert device.bridge.sample_status == BridgeStatus.ENCODER_INVALID
    for _ in range(20):
        device.tick()
    assert device.bridge.sample_status == 0


@LINKS
def test_status_has_the_newest_heartbeat(library: Library, link: int) -> None:
    device = Device(library, link, CLOCK - 300)
    first = device.ask(frames.Start())
    assert isinstance(first, frames.Status)
    assert (first.heartbeats, first.heartbeat_sequence, first.heartbeat_t_us) == (0, 0, 0)
    for _ in range(3):
        device.now_us += 150
        device.beat(0)
    received_us, number = device.now_us, device.sequence - 1
    device.now_us += 99
    status = device.ask(frames.Start())
    assert isinstance(status, frames.Status)
    assert (status.heartbeats, status.heartbeat_sequence) == (3, number)
    assert (status.heartbeat_t_us, status.t_us) == (received_us % CLOCK, device.now_us % CLOCK)


@LINKS
def test_lost_corrupt_and_repeated_frames_are_counted(library: Library, link: int) -> None:
    device = Device(library, link)
    device.beat(0)
    device.sequence += 2  # two are lost
    device.beat(0)
    device.send(frames.Heartbeat(1), device.sequence - 1)  # repeated
    for data in device.wire(frames.Heartbeat(1)):  # corrupt, and then missing: one
        device.receive(data[:-3] + bytes((data[-3] ^ 8,)) + data[-2:])
    status = device.ask(frames.Start())
    assert isinstance(status, frames.Status)
    assert status.errors == 4
    assert status.heartbeats == 2
    assert not device.closed


def test_frames_of_a_board_are_no_frames_of_a_host(library: Library) -> None:
    """Receive and transmit lines that touch: the board receives its own frames."""
    device = Device(library)
    device.answers()
    device.beat(1)
    for frame in (frames.Hello(1, 0, bytes(16), 0, 0, 0, 0), frames.Sample(0, 0, 0, 0)):
        device.send(frame, 500)
    status = device.ask(frames.Start())
    assert isinstance(status, frames.Status)
    assert (status.errors, status.heartbeats) == (2, 1)
    assert device.bridge.receiver.check.expected == device.sequence


@LINKS
def test_overflow_drops_samples_counts_them_and_keeps_answers(library: Library, link: int) -> None:
    device = streaming(library, link=link)
    device.answers()
    device.host.room = 0
    device.pass_us(100_000)  # 100 samples, 2 status frames; the ring holds 64, 8 not for samples
    device.answers()
    device.send(frames.Start())
    device.host.room = 2**32 - 1
    got = device.answers()
    (*_, status) = statuses(got)
    assert len(samples(got)) + status.dropped == 100
    assert len(samples(got)) == 55  # and one Status
    assert len(statuses(got)) == 3
    assert device.link_errors == 0
    assert [frame.t_us for frame in samples(got)] == sorted(frame.t_us for frame in samples(got))


def test_a_full_ring_forgets_answers_and_lives(library: Library) -> None:
    device = Device(library)
    device.host.room = 0
    for _ in range(200):
        device.send(frames.HelloRequest(frames.PROTOCOL))
        device.send(frames.Start())
        device.answers()
    device.host.room = 2**32 - 1
    assert len(device.answers()) == 65
    assert device.link_errors == 0
    assert isinstance(device.ask(frames.HelloRequest(frames.PROTOCOL)), frames.Hello)


@LINKS
@given(rooms=st.lists(st.integers(0, 120), min_size=1, max_size=30))
@settings(max_examples=examples(30))
def test_a_link_that_takes_little_at_a_time_loses_nothing(
    library: Library, link: int, rooms: list[int]
) -> None:
    device = Device(library, link)
    device.host.room = 0
    for _ in range(5):
        device.send(frames.HelloRequest(frames.PROTOCOL))
    got = []
    for room in [*rooms, 10_000]:
        device.host.room = room
        got += device.answers()
    assert len(got) == 6
    assert device.link_errors == 0


def test_the_ring_goes_on_when_its_counts_wrap(library: Library) -> None:
    ring = library.ffi.new("struct ring *")
    ring.head = ring.tail = CLOCK - 3
    frame = library.ffi.new("union bridge_frame *")
    for number in range(64):
        frame.sequence = number
        assert library.lib.ring_put(ring, frame, 0)
    assert not library.lib.ring_put(ring, frame, 0)
    for number in range(64):
        assert library.lib.ring_take(ring, frame)
        assert frame.sequence == number
    assert not library.lib.ring_take(ring, frame)
    for keep_free, count in ((8, 56), (0, 64)):
        while library.lib.ring_put(ring, frame, keep_free):
            pass
        assert (ring.head - ring.tail) % CLOCK == count


def test_the_watchdog_is_fed_only_if_both_live(library: Library) -> None:
    device = Device(library)
    device.answers()
    assert device.host.feeds == 0
    device.pass_us(TICK_US)
    assert device.host.feeds == 0
    device.answers()
    assert device.host.feeds == 1
    device.answers()
    device.answers()
    assert device.host.feeds == 1  # the tick interrupt does not run
    device.pass_us(2 * TICK_US)
    assert device.host.feeds == 1  # the main loop does not run
    device.answers()
    assert device.host.feeds == 2


@pytest.mark.parametrize(
    "step_us", [0, TICK_US // 2 - 1, TICK_US // 2], ids=["stands", "crawls", "runs"]
)
@pytest.mark.parametrize("now_us", [0, CLOCK - 5 * TICK_US])
def test_a_clock_that_does_not_run_feeds_no_watchdog(
    library: Library, now_us: int, step_us: int
) -> None:
    """The host is dead, and by such a clock its heartbeat timeout never ends, or late."""
    device = Device(library, now_us=now_us)
    device.close_line()
    device.pass_us(TICK_US)
    device.answers()
    fed = device.host.feeds
    for _ in range(20):
        device.now_us += step_us
        device.tick()
        device.answers()
    assert device.closed  # so the watchdog has to open it
    assert (device.host.feeds > fed) == (step_us >= TICK_US // 2)


def test_the_cores_self_test(library: Library) -> None:
    assert library.lib.self_test()


@pytest.mark.parametrize("board", [{"self_test_result": False}, {"tick_max_Hz": 1999}])
def test_a_failed_self_test_keeps_the_line_open_for_good(
    library: Library, board: dict[str, int]
) -> None:
    device = Device(library, **board)
    assert isinstance(device.answers()[0], frames.Hello)
    device.host.tick_Hz = 2000
    for _ in range(3):
        device.send(frames.HelloRequest(frames.PROTOCOL))
        device.beat(0)
        device.beat(1)
        device.pass_us(1000)
        assert not device.closed
        device.send(frames.Stop())
    device.send(frames.Start())
    device.pass_us(10_000)
    *_, status = statuses(device.answers())
    assert status.status & BridgeStatus.FAULT
    assert not status.status & BridgeStatus.BARRED
    assert not status.status & BridgeStatus.ENABLE_LINE


def test_another_protocol_opens_the_line_and_keeps_it_so(library: Library) -> None:
    device = Device(library)
    device.close_line()
    assert device.closed
    assert isinstance(device.ask(frames.HelloRequest(frames.PROTOCOL + 1)), frames.Hello)
    assert not device.closed
    device.beat(0)
    device.beat(1)
    device.pass_us(20_000)
    assert not device.closed
    assert barred(device)
    device.send(frames.HelloRequest(frames.PROTOCOL))
    assert not barred(device)
    device.beat(1)
    assert not device.closed
    device.close_line()
    assert device.closed
    assert not barred(device)


def barred(device: Device) -> bool:
    """Return what the board says of it in Status."""
    status = device.ask(frames.Start())
    assert isinstance(status, frames.Status)
    return bool(status.status & BridgeStatus.BARRED)


def test_status_reports_the_line(library: Library) -> None:
    device = Device(library)
    device.pass_us(20_000)
    device.close_line()
    answers = [device.ask(frames.Start())]
    device.pass_us(50_000)
    answers.append(device.ask(frames.Start()))
    device.beat(0)
    answers.append(device.ask(frames.Start()))
    assert [frame.status for frame in answers if isinstance(frame, frames.Status)] == [
        BridgeStatus.ENABLE_LINE,
        BridgeStatus.HEARTBEAT_LOST,
        0,
    ]


@pytest.mark.parametrize("rate_Hz", [100, 1000, 5000, 20_000])
@pytest.mark.parametrize("ending", ["silence", "heartbeat 0", "stop", "configure"])
def test_the_first_sample_after_the_line_opened_says_so(
    library: Library, rate_Hz: int, ending: str
) -> None:
    """Not one sample later: a tick judges the line before it samples."""
    device = streaming(library, rate_Hz)
    device.close_line()
    device.pass_us(30_000)
    device.answers()
    opened_us = device.now_us
    if ending == "silence":
        opened_us += 20_000  # of the timeout of 50 ms 30 are over
    elif ending == "heartbeat 0":
        device.beat(0)
    else:
        device.send(frames.Stop() if ending == "stop" else frames.Configure(rate_Hz, 50_000))
        device.send(frames.Start())
    received = []
    for _ in range(20):
        device.pass_us(2000)
        received += samples(device.answers())
    lost = BridgeStatus.HEARTBEAT_LOST if ending == "silence" else 0
    line = BridgeStatus.ENABLE_LINE | BridgeStatus.HEARTBEAT_LOST
    assert received[0].t_us <= opened_us + 1_000_000 // rate_Hz
    for sample in received:
        closed = sample.t_us < opened_us
        assert sample.status & line == (BridgeStatus.ENABLE_LINE if closed else lost)


def test_the_line_is_driven_at_every_tick(library: Library) -> None:
    """A pin that something else changed is put right."""
    device = Device(library)
    device.host.line_closed = True
    device.tick()
    assert not device.closed
    device.close_line()
    device.host.line_closed = False
    device.tick()
    assert device.closed


def test_a_body_that_does_not_end_is_an_error(library: Library) -> None:
    device = Device(library, 1)
    device.beat(0)
    device.receive(device.wire(frames.Configure(1000, 50_000))[0])
    status = device.ask(frames.Start())
    assert isinstance(status, frames.Status)
    assert status.errors == 1
