"""Every source of slow channels against a peer of its own, on a real socket, bus or terminal.

What all promise: the number that the peer has, a DeviceError that says what to do when the peer is
gone, and a number again when it is back.
"""

import contextlib
import os
import time
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from motord.config import ChannelConfig, Config, load, packaged
from motord.emulate.devices import ReadOnlyRegisters
from motord.emulate.modbus import ModbusServers
from motord.hal.base import DeviceError
from motord.hal.channel_source import ChannelReading, ChannelSource, RawSample
from motord.hal.channels.line_poller import OPEN_AGAIN_S, LinePoller
from motord.hal.channels.registry import check_drivers, make_lines
from motord.rig.truth import load as load_rig
from motord.schema import TICK_DTYPE, InverterStatus
from motord.wire.can.dbc import signal_codec
from tests.support.channel_package import install
from tests.support.patience import PATIENCE_S
from tests.support.ports import free_port

DBC = packaged("inverter.dbc")
TEMPERATURE = "InverterStatus.Temperature"


def bench(*sources: dict[str, Any], **values: Any) -> Config:
    channels = [
        {"name": f"c{n}", "unit": "K", "source": source, **values}
        for n, source in enumerate(sources)
    ]
    return Config.model_validate({**load().model_dump(), "channels": channels})


class Peer:
    """A device: `set` what its channel c0 reads; `leave` it, and `join` again."""

    def __init__(self, config: Config) -> None:
        self.config = config

    def set(self, value: float) -> None: ...
    def join(self) -> None: ...
    def leave(self) -> None: ...


class ModbusPeer(Peer):
    def __init__(self, **place: Any) -> None:
        source = {"driver": "modbus", "unit": 3, "timeout_s": 0.2, **place}
        one = {**source, "address": 7, "emulated": "winding_C", "kind": "i32"}
        super().__init__(bench(one, {**source, "address": 11, "table": "holding"}))
        self.values = {"winding_C": 0.0, "magnet_C": 1.0, "housing_C": 2.0}

    def set(self, value: float) -> None:
        self.values["winding_C"] = value

    def join(self) -> None:
        registers = ReadOnlyRegisters(self.config.channels, lambda: self.values)
        source: Any = self.config.channels[0].source
        self.servers = ModbusServers({"peer": (source, registers)})
        self.servers.start()

    def leave(self) -> None:
        self.servers.close()


class CanPeer(Peer):
    def __init__(self, name: str) -> None:
        bus = {"interface": "virtual", "channel": name, "fd": False}
        source = {"driver": "can", "dbc": str(DBC), "signal": TEMPERATURE, "bus": bus}
        super().__init__(bench(source))
        self._codec = signal_codec(DBC, TEMPERATURE)
        self._bus = can.Bus(name, "virtual")

    def set(self, value: float) -> None:
        for key, payload in (
            (0x7FF, b"1"),
            (self._codec.identifier, self._codec.encode((value,))),
        ):
            self._bus.send(can.Message(arbitration_id=key, data=payload, is_extended_id=False))

    def leave(self) -> None:
        self._bus.shutdown()


class TextPeer(Peer):
    """A line of text, sent by itself or when it is asked."""

    def __init__(self, link: Path, request: str = "") -> None:
        source = {"driver": "serial", "port": str(link), "timeout_s": 0.2, "request": request}
        pattern = r"T=(?P<value>\S+)"
        super().__init__(bench({**source, "pattern": pattern}))
        self._link, self._request = link, request
        self._value = 0.0

    def join(self) -> None:
        self._device, self._host = os.openpty()
        tty.setraw(self._host)
        os.set_blocking(self._device, False)
        self._link.symlink_to(os.ttyname(self._host))

    def set(self, value: float) -> None:
        self._value = value
        if not self._request:
            self.say(b"0\r\nP=3\r\nT=%g\r\n" % value)

    def answer(self) -> None:
        with contextlib.suppress(BlockingIOError):
            if os.read(self._device, 99).decode() == self._request:
                self.say(b"T=%g\n" % self._value)

    def say(self, text: bytes) -> None:
        os.write(self._device, text)

    def leave(self) -> None:
        self._link.unlink()
        os.close(self._device)
        os.close(self._host)


@contextlib.contextmanager
def joined(peer: Peer) -> Iterator[Peer]:
    peer.join()
    try:
        yield peer
    finally:
        with contextlib.suppress(Exception):
            peer.leave()


@pytest.fixture(params=["tcp", "rtu", "can", "text"])
def peer(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Peer]:
    made = {
        "tcp": lambda: ModbusPeer(tcp_port=free_port()),
        "rtu": lambda: ModbusPeer(transport="rtu", serial_port=str(tmp_path / "line")),
        "can": lambda: CanPeer(f"channels-{tmp_path.name}"),
        "text": lambda: TextPeer(tmp_path / "port"),
    }[request.param]()
    with joined(made) as peer:
        yield peer


def first(config: Config) -> ChannelSource:
    return make_lines(config)[0][0][1]


def read(source: ChannelSource, peer: Peer, value: float) -> RawSample:
    """Return the first sample of this value; errors of a peer that comes back are waited out."""
    end_s = time.monotonic() + PATIENCE_S
    error: object = "another value"
    while time.monotonic() < end_s:
        try:
            source.open()
            peer.set(value)
            sample = source.read()
            if sample is not None and sample.value == value:
                return sample
        except DeviceError as why:
            error = why
            source.close()
        time.sleep(0.01)
    raise AssertionError(f"no {value} came: {error}")


GONE = r"no valid answer|refused|cannot open"


def open_and_read(source: ChannelSource) -> None:
    source.open()
    source.read()


def test_it_reads_what_the_peer_has_also_after_the_peer_was_gone(peer: Peer) -> None:
    source = first(peer.config)
    try:
        for value in (42.0, -17.0, 0.0):
            sample = read(source, peer, value)
            assert 0.0 <= sample.age_s < PATIENCE_S
        if not isinstance(peer, CanPeer):  # a bus stays when a device leaves it
            peer.leave()
            for words in (r"no valid answer|refused|lost|does not answer", GONE, GONE):
                with pytest.raises(DeviceError, match=words):
                    open_and_read(source)
                source.close()
            peer.join()
            assert read(source, peer, 12.0).value == 12.0
    finally:
        source.close()
        source.close()


def test_registers_share_a_connection_and_one_that_is_missing_is_named() -> None:
    with joined(ModbusPeer(tcp_port=free_port(), timeout_s=5.0)) as peer:
        assert isinstance(peer, ModbusPeer)
        [[(_, one), (_, other)]] = make_lines(peer.config)
        peer.set(5.0)
        assert one.read() == RawSample(5.0)
        with pytest.raises(DeviceError, match=r"holding register 11: .* exception 2 \(no such reg"):
            other.read()
        other.close()  # as after each error; the link is not to blame
        peer.servers.close()
        with pytest.raises(DeviceError, match="lost"):  # so it was still the same one
            one.read()
        one.close()
        peer.join()
        assert one.read() == RawSample(5.0)
        one.close()


def test_a_serial_line_is_left_alone_after_a_reading_that_failed() -> None:
    """A response that comes late must not be taken for the one to the next request."""
    from motord.config.channel_sources import ModbusSource
    from motord.hal.channels.modbus import ModbusChannel

    class Silent:
        def exchange(self, *_request: object) -> list[int]:
            raise DeviceError("no answer")

    for transport, expected in (("rtu", [0.25]), ("tcp", [])):
        waited: list[float] = []
        settings = {"transport": transport, "serial_port": "x", "timeout_s": 0.25}
        source = ModbusSource(driver="modbus", address=1, **settings)
        client: Any = Silent()
        with pytest.raises(DeviceError):
            ModbusChannel(source, client, waited.append).read()
        assert waited == expected
        assert source.read_s == source.timeout_s + sum(expected)


def test_frames_that_are_old_are_not_read_again_and_wrong_ones_are_no_number() -> None:
    peer = CanPeer("channels-old")
    source = first(peer.config)
    try:
        read(source, peer, 20.0)
        assert source.read() is None
        key = signal_codec(DBC, TEMPERATURE).identifier
        peer._bus.send(can.Message(arbitration_id=key, data=b"1", is_extended_id=False))
        sample = source.read()
        assert sample is not None
        assert np.isnan(sample.value)
    finally:
        source.close()
        peer.leave()


def test_a_signal_that_the_dbc_does_not_have_costs_its_own_channel() -> None:
    bus = {"interface": "virtual", "channel": "x", "fd": False}
    source = {"driver": "can", "dbc": str(DBC), "signal": TEMPERATURE, "bus": bus}
    wrong = {**source, "signal": "InverterStatus.Temprature"}
    [[(_, missing), (_, there)]] = make_lines(bench(wrong, source))
    with pytest.raises(DeviceError, match=r"inverter.dbc: signal: .*did you mean Temperature"):
        missing.open()
    there.open()
    assert there.read() is None
    there.close()


def test_lines_of_text_half_lines_and_what_is_no_number(tmp_path: Path) -> None:
    with joined(TextPeer(tmp_path / "port")) as peer:
        assert isinstance(peer, TextPeer)
        source = first(peer.config)
        source.open()
        for said, expected in (
            (b"T=12", None),  # it may have begun before
            (b"3\nT=4", None),
            (b",5\r\n", 4.5),
            (b"P=1\n", None),
            (b"T=1\nT=2\nP=3\n", 2.0),
            (b"T=-1.5e1 C\n", -15.0),
            (b"x" * 5000, None),
            (b"T=8\nT=9\n", 9.0),
        ):
            for at in range(0, len(said), 1000):
                peer.say(said[at : at + 1000])
                sample = source.read()
            assert (sample and sample.value) == expected, said
        peer.say(b"T=OPEN\n")
        sample = source.read()
        assert sample is not None
        assert np.isnan(sample.value)
        source.close()


def test_an_instrument_that_is_asked(tmp_path: Path) -> None:
    import threading

    with joined(TextPeer(tmp_path / "port", "MEAS?\r\n")) as peer:
        assert isinstance(peer, TextPeer)
        source, over = first(peer.config), threading.Event()

        def answer() -> None:
            while not over.wait(0.005):
                peer.answer()

        peer.set(21.5)
        source.open()
        peer.say(b"T=99\n")  # not asked for
        thread = threading.Thread(target=answer)
        thread.start()
        try:
            assert read(source, peer, 21.5)
        finally:
            over.set()
            thread.join()
        with pytest.raises(DeviceError, match=r"within 0.2 s of the request"):
            source.read()
        source.close()


def test_simulated_temperatures_follow_the_currents_of_the_ticks() -> None:
    ticks = np.zeros(30_000, TICK_DTYPE)
    ticks["i_a_A"], ticks["i_b_A"] = 20.0, -20.0
    blocks = [ticks[:10_000], ticks[10_000:]]
    config = bench(*({"driver": "simulated", "quantity": f"{node}_C"}
                     for node in ("winding", "magnet", "housing")))  # fmt: skip
    [line] = make_lines(config, lambda: blocks.pop(0) if blocks else ticks[:0])
    values = [source.read() for _, source in line]
    winding_C, magnet_C, housing_C = (sample.value for sample in values if sample is not None)
    assert 25.0 < magnet_C < housing_C < winding_C < 45.0
    assert winding_C > 35.0
    for _, source in line:
        source.open()
        source.close()


def test_drivers_of_other_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = tmp_path / "probe"
    install(tmp_path, monkeypatch)
    acme = {"driver": "scripted", "settings": {"script": str(script)}}
    config = bench(acme, acme, {"driver": "scripted", "settings": {"scrpt": "x"}})
    check_drivers(config.channels)
    lines = make_lines(config)
    assert [len(line) for line in lines] == [1, 1, 1]  # a thread each
    script.write_text("7.5")
    assert lines[0][0][1].read() == RawSample(7.5)
    with pytest.raises(DeviceError, match=r"\[channels.source.settings\] s.*: .*required"):
        lines[2][0][1].open()
    with pytest.raises(DeviceError, match=r'"c0": driver = "acme" is not known; known: .*scripted'):
        check_drivers(bench({"driver": "acme"}).channels)


class Scripted:
    """A source that does what a list says: a number, None, an error, with the time it takes."""

    def __init__(self, *script: object) -> None:
        self.script = list(script)
        self.done: list[str] = []

    def open(self) -> None:
        self.done.append("open")
        if self.script[0] == "closed":
            self.script.pop(0)
            raise DeviceError("not there")

    def read(self) -> Any:
        self.done.append("read")
        said = self.script.pop(0)
        if isinstance(said, Exception):
            raise said
        return said

    def close(self) -> None:
        self.done.append("close")


class Clock:
    now_ns = 0

    def __call__(self) -> int:
        return self.now_ns


def reader(clock: Clock, *sources: Scripted, **values: Any) -> tuple[LinePoller, list[Any]]:
    readings: list[ChannelReading] = []
    config = bench(*({"driver": "simulated"} for _ in sources), **values)
    pairs: list[tuple[ChannelConfig, ChannelSource]] = list(
        zip(config.channels, sources, strict=True)
    )
    return LinePoller(pairs, readings.append, clock), readings


def test_readings_have_the_time_at_which_they_began_less_their_age() -> None:
    clock = Clock()
    line, readings = reader(clock, Scripted(RawSample(1.0), None, RawSample(2.0, 0.25)))
    assert line.step() == 1.0
    for clock.now_ns in (10**9, 2 * 10**9):
        line.step()
    assert readings == [ChannelReading("c0", 0, 1.0), ChannelReading("c0", 1_750_000_000, 2.0)]


def test_errors_of_device_and_driver_are_passed_on_and_the_source_is_opened_again() -> None:
    clock, source = Clock(), Scripted(DeviceError("off"), 1 / 3, "closed", "closed", RawSample(4.0))
    line, readings = reader(clock, source, rate_Hz=10.0)
    while source.script:
        clock.now_ns += round(line.step() * 1e9)
        assert clock.now_ns < 4 * OPEN_AGAIN_S * 1e9
    errors = [reading.error for reading in readings]
    assert errors[0] == "off"
    assert errors[1].startswith("error in its driver: AttributeError: 'float' object")
    assert errors[2:] == ["not there", "not there", ""]
    calls = "open read close open read close open close open close open read"
    assert " ".join(source.done) == calls
    assert readings[-1].t_ns - readings[2].t_ns == 2 * OPEN_AGAIN_S * 1e9


def test_what_waited_during_a_pause_is_old_and_left_out() -> None:
    clock = Clock()
    line, readings = reader(clock, Scripted(*map(RawSample, (1.0, 2.0, 3.0))), timeout_s=3.0)
    line.step()
    clock.now_ns = round(3.1e9)
    while clock.now_ns < 6e9 and len(readings) < 2:
        clock.now_ns += round(max(line.step(), 0.001) * 1e9)
    assert [reading.raw for reading in readings] == [1.0, 3.0]


def test_channels_of_a_line_take_turns() -> None:
    clock = Clock()
    slow, fast = Scripted(*[RawSample(1.0)] * 3), Scripted(*[RawSample(2.0)] * 9)
    line, readings = reader(clock, slow, fast, rate_Hz=10.0)
    for _ in range(3):
        clock.now_ns += round(line.step() * 1e9) or 1
    assert [reading.name for reading in readings] == ["c0", "c1"] * 3
    line.close()
    assert slow.done[-1] == fast.done[-1] == "close"


def test_the_simulated_power_is_the_mean_since_the_reading_before() -> None:
    ticks = np.zeros(2_000, TICK_DTYPE)
    ticks["u_a_V"], ticks["i_a_A"], ticks["inverter_status"] = 10.0, 3.0, InverterStatus.READY
    ticks["u_a_V"][1000:] = 20.0
    blocks = [ticks[:500], ticks[500:1000], ticks[1000:]]
    config = bench({"driver": "simulated", "quantity": "dc_power_W"})
    [[(_, source)]] = make_lines(config, lambda: blocks.pop(0) if blocks else ticks[:0])
    truth = load_rig(config.bench.rig).inverter
    sample, expected_A = source.read(), 3.0 * truth.alpha[0] + truth.beta_A[0]
    assert sample is not None
    assert sample.value == pytest.approx(15.0 * expected_A)
    assert source.read() is None
    blocks.append(ticks[1000:])
    sample = source.read()
    assert sample is not None
    assert sample.value == pytest.approx(20.0 * expected_A)
    ticks["inverter_status"] = 0
    blocks.append(ticks)
    sample = source.read()
    assert sample is not None
    assert sample.value == 0.0
