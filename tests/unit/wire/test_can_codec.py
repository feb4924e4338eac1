"""The compiled codec against cantools, over random layouts and over the packaged DBC."""

import math
from dataclasses import dataclass
from typing import Any

import pytest
from cantools.database.can import Message, Signal
from cantools.database.conversion import BaseConversion
from hypothesis import given
from hypothesis import strategies as st

from motord.config import CanSignalMap, packaged
from motord.schema import InverterStatus
from motord.wire.can import dbc
from motord.wire.can.codec import FEEDBACK_SLOTS, Checks, InverterCodec, MessageCodec
from motord.wire.can.signal import SignalCodec
from motord.wire.crc import crc8
from tests.contract.peers import SIGNALS, encode_feedback

SCALES = [1, 2, 0.002, 0.5, -0.25, 1e-6, 3.7]
OFFSETS = [0, 0.5, -40, 1000]
DATABASE = dbc.read_database(packaged("inverter.dbc"))


@dataclass
class Layout:
    message: Message
    codec: MessageCodec


def _make(message: Message) -> Layout:
    signals = {s.name: SignalCodec(s, message.length) for s in message.signals}
    return Layout(message, MessageCodec("M", 1, message.length, signals, Checks()))


@st.composite
def layouts(draw: Any, floats: bool = True) -> Layout:
    """A message of blocks of whole bytes, each block of one byte order, with gaps."""
    signals: list[Signal] = []
    block_byte = 0
    for _ in range(draw(st.integers(1, 4))):
        block_bytes = draw(st.integers(1, 16))
        order = draw(st.sampled_from(["little_endian", "big_endian"]))
        at = 0
        while at < 8 * block_bytes:
            at += draw(st.integers(0, 7))
            is_float = floats and draw(st.booleans())
            width = draw(st.sampled_from([16, 32, 64]) if is_float else st.integers(1, 64))
            if at + width > 8 * block_bytes:
                break
            # in big-endian blocks `at` counts from the highest bit of the first byte
            start = at if order == "little_endian" else 8 * (at // 8) + 7 - at % 8
            conversion = BaseConversion.factory(
                scale=draw(st.sampled_from(SCALES)),
                offset=draw(st.sampled_from(OFFSETS)),
                is_float=is_float,
            )
            signals.append(
                Signal(
                    name=f"S{len(signals)}",
                    start=8 * block_byte + start,
                    length=width,
                    byte_order=order,
                    is_signed=draw(st.booleans()) and not is_float,
                    conversion=conversion,
                )
            )
            at += width
        block_byte += block_bytes
    length = draw(
        st.sampled_from([n for n in (*range(9), 12, 16, 20, 24, 32, 48, 64) if n >= block_byte])
    )
    return _make(Message(frame_id=1, name="M", length=length, signals=signals, is_fd=True))


def close(ours: float, theirs: float) -> bool:
    if math.isnan(ours) or math.isnan(theirs):
        return math.isnan(ours) and math.isnan(theirs)
    return ours == theirs or math.isclose(ours, theirs, rel_tol=1e-12, abs_tol=1e-300)


@given(layouts(), st.data())
def test_decodes_as_cantools_does(layout: Layout, draw: st.DataObject) -> None:
    size = layout.message.length
    payload = draw.draw(st.binary(min_size=size, max_size=size))
    theirs = layout.message.decode(payload, decode_choices=False)
    ours = layout.codec.decode(payload)
    assert ours is not None
    for name, value in zip(layout.codec.slots, ours, strict=True):
        assert close(value, float(theirs[name])), name


@given(layouts(), st.data())
def test_encodes_as_cantools_does(layout: Layout, draw: st.DataObject) -> None:
    """From raw values of at most 32 bits (beyond, scaling rounds), as physical values."""
    raws: dict[str, Any] = {}
    for signal in layout.message.signals:
        low = -(2 ** (signal.length - 1)) if signal.is_signed else 0
        high = 2 ** (signal.length - 1) - 1 if signal.is_signed else 2**signal.length - 1
        raws[signal.name] = (
            float(draw.draw(st.integers(-1000, 1000)))
            if signal.is_float
            else draw.draw(st.integers(max(low, -(2**31)), min(high, 2**31)))
        )
    values = [raws[s.name] * s.scale + s.offset for s in layout.message.signals]
    ours = layout.codec.encode([float(value) for value in values])
    back = layout.message.decode(ours, decode_choices=False, scaling=False)
    for signal in layout.message.signals:
        if signal.is_float:
            # the smallest format holds 11 bits
            assert float(back[signal.name]) == pytest.approx(raws[signal.name], rel=1e-3, abs=1e-3)
        else:
            assert back[signal.name] == raws[signal.name]
    if not any(signal.is_float for signal in layout.message.signals):
        assert ours == layout.message.encode(raws, scaling=False)


@given(
    layouts(),
    st.data(),
    st.sampled_from([math.nan, math.inf, -math.inf, 1e308, -1e308, 1e19, -1e19]),
)
def test_saturates_and_never_wraps(layout: Layout, draw: st.DataObject, wild: float) -> None:
    """A wild value comes back as the end of the range on its side, and touches no neighbour."""
    victim = draw.draw(st.integers(0, max(len(layout.codec.slots) - 1, 0)))
    if not layout.codec.slots:
        return
    quiet = [0.0] * len(layout.codec.slots)
    loud = list(quiet)
    loud[victim] = wild
    before = layout.codec.decode(layout.codec.encode(quiet))
    after = layout.codec.decode(layout.codec.encode(loud))
    assert before is not None
    assert after is not None
    assert after[:victim] + after[victim + 1 :] == before[:victim] + before[victim + 1 :]
    if math.isnan(wild):
        assert after[victim] == before[victim]
    elif wild > 0:
        assert after[victim] >= before[victim]
    else:
        assert after[victim] <= before[victim]


@pytest.fixture(scope="module")
def inverter() -> InverterCodec:
    path = packaged("inverter.dbc")
    return dbc.compile_codec(DATABASE, path, CanSignalMap(**SIGNALS))


CURRENT = st.floats(-65.0, 65.0)


@given(st.tuples(CURRENT, CURRENT, CURRENT), st.booleans(), st.integers(0, 10**9))
def test_command_there_and_back(
    inverter: InverterCodec, i_A: tuple[float, ...], enable: bool, counter: int
) -> None:
    payload = inverter.encode_command(i_A, enable, counter)
    decoded = inverter.decode_command(payload)
    assert decoded is not None
    assert decoded[0] == pytest.approx(i_A, abs=0.001 + 1e-9)
    assert decoded[1] is enable
    assert inverter.command.counter(payload) == counter % 16
    theirs: Any = DATABASE.decode_message(0x100, payload)
    assert theirs["CurrentA"] == pytest.approx(decoded[0][0])
    assert theirs["Checksum"] == crc8(payload[:-1]) == payload[-1]


@given(st.fixed_dictionaries({slot: st.floats(-60.0, 60.0) for slot in FEEDBACK_SLOTS}))
def test_feedback_there_and_back(inverter: InverterCodec, values: dict[str, float]) -> None:
    values["status"] = abs(round(values["status"]))
    values["u_bus_V"] = abs(values["u_bus_V"])
    seen: dict[str, float] = {}
    for codec, payload in encode_feedback(inverter, values, 17):
        assert len(payload) == codec.size_bytes
        assert codec.counter(payload) == 1
        decoded = codec.decode(payload)
        assert decoded is not None
        seen |= zip(codec.slots, decoded, strict=True)
    assert seen == pytest.approx(values, abs=0.051)
    assert [seen[f"i_{p}_A"] for p in "abc"] == pytest.approx(
        [values[f"i_{p}_A"] for p in "abc"], abs=0.001 + 1e-9
    )


@given(st.data())
def test_a_spoilt_command_is_refused(inverter: InverterCodec, draw: st.DataObject) -> None:
    payload = bytearray(inverter.encode_command((1.0, 2.0, 3.0), True, 4))
    bit = draw.draw(st.integers(0, 8 * len(payload) - 1))
    payload[bit // 8] ^= 1 << bit % 8
    assert inverter.decode_command(bytes(payload)) is None
    assert inverter.decode_command(bytes(payload[:-1])) is None


def test_limits_of_the_command(inverter: InverterCodec) -> None:
    payload = inverter.encode_command((1e9, -math.inf, math.nan), True, 0)
    decoded = inverter.decode_command(payload)
    assert decoded is not None
    assert decoded[0] == pytest.approx((65.534, -65.536, 0.0))


@pytest.mark.parametrize("bits", range(32))
def test_status_word_there_and_back(inverter: InverterCodec, bits: int) -> None:
    status = InverterStatus(bits) & ~InverterStatus.BUS_OFF
    assert inverter.decode_status(inverter.status_word(status)) == status


def test_a_drive_without_ready_bit_is_ready() -> None:
    path = packaged("inverter.dbc")
    signals = CanSignalMap(**(SIGNALS | {"status_ready_mask": 0, "status_fault_mask": 0x30}))
    codec = dbc.compile_codec(dbc.read_database(path), path, signals)
    assert codec.decode_status(0) == InverterStatus.READY
    assert codec.decode_status(0x10) == InverterStatus.READY | InverterStatus.FAULT


def test_a_drive_without_ready_bit_is_not_ready_once_commands_were_missing() -> None:
    """Its power stage is off by then: what else would show it, with little current commanded?"""
    path = packaged("inverter.dbc")
    changes = {"status_ready_mask": 0, "status_timeout_mask": 0x40}
    codec = dbc.compile_codec(dbc.read_database(path), path, CanSignalMap(**(SIGNALS | changes)))
    assert codec.decode_status(0x40) == InverterStatus.COMMAND_TIMEOUT
    assert codec.decode_status(0) == InverterStatus.READY
