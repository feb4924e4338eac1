"""The drives of docs/drives.md: maps that load, and frames as their makers' documents show them."""

import re
import struct
import tomllib
from pathlib import Path
from typing import Any

import pytest

from motord.config import CanConfig, packaged
from motord.config.devices import InverterConfig
from motord.schema import InverterStatus
from motord.wire.can import dbc
from motord.wire.can.codec import InverterCodec
from motord.wire.can.frame_format import EXTENDED
from tests.contract.peers import DQ_SIGNALS

DOCS = Path(__file__).parents[3] / "docs" / "drives.md"
EXAMPLES = re.findall(r"```toml\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)


def inverter_of(example: str) -> InverterConfig:
    section: dict[str, Any] = tomllib.loads(example)["inverter"]
    section["can"]["dbc"] = packaged(section["can"]["dbc"].removeprefix("package:"))
    return InverterConfig.model_validate(section)


INVERTERS = {inverter_of(example).can.dbc.stem: inverter_of(example) for example in EXAMPLES}


def drive(name: str) -> InverterCodec:
    can = INVERTERS[name].can
    assert can is not None
    return dbc.load(can)


@pytest.mark.parametrize("name", ["moteus", "vesc", "odrive", "cia402"])
def test_every_example_loads(name: str) -> None:
    codec = drive(name)
    assert INVERTERS[name].q_only == (name != "moteus")
    assert INVERTERS[name].can.signals.feedback_u_bus_V
    payload = codec.encode_command((0.0, 0.0), False, 0)
    assert codec.decode_command(payload) == ((0.0, 0.0, 0.0), not codec.signals.command_enable)


def test_vesc_current_as_in_its_document() -> None:
    """51 A are 0000C738; the identifier is the command, 1, and the VESC's."""
    command = drive("vesc").command
    assert command.key == 0x101 | EXTENDED
    assert drive("vesc").encode_command((0.0, 51.0), True, 0).hex() == "0000c738"
    status, *_ = (m for m in drive("vesc").feedback if m.name == "Status")
    assert status.identifier == 0x901
    assert status.decode(struct.pack(">ihh", 4200, -123, 95)) == (-12.3,)
    assert {m.identifier for m in drive("vesc").feedback} == {0x901, 0x1001, 0x1B01}


def test_vesc_says_nothing_of_its_state() -> None:
    assert drive("vesc").decode_status(0) == InverterStatus.READY


def test_odrive_takes_a_float() -> None:
    codec = drive("odrive")
    assert codec.command.identifier == 1 << 5 | 0x0E
    assert codec.encode_command((0.0, 2.5), True, 0) == struct.pack("<f", 2.5)
    by_name = {m.name: m for m in codec.feedback}
    assert by_name["GetIq"].decode(struct.pack("<ff", 1.0, -3.5)) == (-3.5,)
    values = by_name["Heartbeat"].decode(struct.pack("<IB3x", 0, 8))
    assert values == (8.0,)
    assert codec.decode_status(8) == InverterStatus.READY
    assert codec.decode_status(1) == InverterStatus(0)


def test_moteus_subframes() -> None:
    """Write mode 9, write q and d, read mode, both currents, and voltage to fault."""
    codec = drive("moteus")
    assert codec.command.key == 0x8001 | EXTENDED
    payload = codec.encode_command((-1.5, 6.25), True, 0)
    currents = struct.pack("<ff", 6.25, -1.5).hex()
    assert payload.hex() == "010009" + "0e1c" + currents + "1100" + "1e04" + "170d" + "50"
    assert codec.encode_command((0.0, 0.0), False, 0)[2] == 0
    reply = bytes.fromhex("21000a2e04") + struct.pack("<ff", 6.0, -1.0)
    reply += bytes.fromhex("270d") + struct.pack("<hhh", 241, 305, 0) + b"\x50" * 3
    values = dict(zip(codec.feedback[0].slots, codec.feedback[0].decode(reply) or (), strict=True))
    assert values == pytest.approx(
        {"u_bus_V": 24.1, "temperature_C": 30.5, "status": 10, "i_d_A": -1.0, "i_q_A": 6.0}
    )


@pytest.mark.parametrize(
    ("word", "status"),
    [
        (9, InverterStatus.READY),
        (1, InverterStatus.FAULT),
        (11, InverterStatus.COMMAND_TIMEOUT),
        (10, InverterStatus(0)),
        (0, InverterStatus(0)),
    ],
)
def test_a_mode_as_status(word: int, status: InverterStatus) -> None:
    codec = drive("moteus")
    assert codec.decode_status(word) == status
    assert codec.status_word(status) == (word if status else 0)


@pytest.mark.parametrize(
    ("word", "status"),
    [
        (0x0637, InverterStatus.READY),
        (0x0631, InverterStatus(0)),
        (0x0218, InverterStatus.FAULT),
        (0x0633, InverterStatus(0)),
    ],
)
def test_the_status_word_of_cia_402(word: int, status: InverterStatus) -> None:
    assert drive("cia402").decode_status(word) == status


def test_the_control_word_of_cia_402() -> None:
    codec = drive("cia402")
    assert codec.encode_command((0.0, 250.0), True, 0) == struct.pack("<Hh", 15, 250)
    assert codec.encode_command((0.0, 0.0), False, 0) == struct.pack("<Hh", 6, 0)


def test_dq_drive_is_a_whole_map() -> None:
    codec = dbc.load(CanConfig(dbc=packaged("dq_drive.dbc"), fd=False, signals=DQ_SIGNALS))
    assert (codec.command.identifier, codec.command.size_bytes) == (0x110, 8)
    payload = codec.encode_command((-2.0, 7.5), True, 3)
    assert codec.decode_command(payload) == ((-2.0, 7.5, 0.0), True)
    assert codec.command.counter(payload) == 3
    assert all(m.checks.crc_byte == 7 for m in (codec.command, *codec.feedback))
