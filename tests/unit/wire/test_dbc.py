"""A wrong DBC or a wrong name in the signal map is one clear line."""

from pathlib import Path
from typing import Any

import pytest

from motord.config import CanConfig, ConfigError, packaged
from motord.wire.can import dbc
from motord.wire.can.codec import InverterCodec
from motord.wire.can.frame_format import EXTENDED
from tests.contract.peers import SIGNALS

HEADER = 'VERSION ""\nNS_ :\nBS_:\nBU_: Host Drive\n'
COMMAND = """
BO_ {identifier} Command: 8 Host
 SG_ RefA : 7|16@0- (0.01,0) [-100|100] "A" Drive
 SG_ RefB : 23|16@0- (0.01,0) [-100|100] "A" Drive
 SG_ RefC : 39|16@0- (0.01,0) [-100|100] "A" Drive
 SG_ Control : 48|4@1+ (1,0) [0|15] "" Drive
 SG_ Mode : 52|4@1+ (1,0) [0|15] "" Drive
 SG_ Alive : 63|8@0+ (1,0) [0|255] "" Drive
"""
FEEDBACK = """
BO_ 2 Currents: 7 Drive
 SG_ A : 0|16@1- (0.01,0) [0|0] "A" Host
 SG_ B : 16|16@1- (0.01,0) [0|0] "A" Host
 SG_ C : 32|16@1- (0.01,0) [0|0] "A" Host
 SG_ Half : 48|4@1+ (1,0) [0|0] "" Host
 SG_ Scaled : 52|4@1+ (2,0) [0|0] "" Host

BO_ 3 State: 2 Drive
 SG_ Word M : 0|8@1+ (1,0) [0|0] "" Host
 SG_ Extra m1 : 8|8@1+ (1,0) [0|0] "" Host

BO_ 4 Other: 2 Drive
 SG_ Count : 0|8@1+ (1,0) [0|0] "" Host
"""
NAMES: dict[str, Any] = {
    "command_i_A": ("Command.RefA", "Command.RefB", "Command.RefC"),
    "command_enable": "Command.Control",
    "feedback_i_A": ("Currents.A", "Currents.B", "Currents.C"),
    "feedback_status": "State.Word",
}


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return write(tmp_path, HEADER + COMMAND.format(identifier=1) + FEEDBACK)


def write(folder: Path, text: str) -> Path:
    path = folder / "drive.dbc"
    path.write_text(text)
    return path


def load(path: Path, fd: bool = True, **names: Any) -> InverterCodec:
    return dbc.load(CanConfig(dbc=path, fd=fd, signals=NAMES | names))


def error_of(path: Path, fd: bool = True, **names: Any) -> str:
    with pytest.raises(ConfigError) as caught:
        load(path, fd, **names)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    return message


def test_the_packaged_dbc_fits_its_documented_map() -> None:
    codec = dbc.load(CanConfig(dbc=packaged("inverter.dbc"), signals=SIGNALS))
    assert (codec.command.identifier, codec.command.size_bytes) == (0x100, 8)
    assert [(m.identifier, m.size_bytes) for m in codec.feedback] == [(0x180, 16), (0x181, 8)]
    assert all(m.checks.crc_byte == m.size_bytes - 1 for m in codec.feedback)


def test_big_endian_command_with_control_word_and_constants(drive: Path) -> None:
    codec = load(
        drive,
        command_enable_value=15,
        command_counter="Command.Alive",
        command_constants={"Command.Mode": 9},
    )
    payload = codec.encode_command((1.0, -1.0, 0.5), True, 0x1FE)
    assert payload.hex() == "0064ff9c00329ffe"
    assert codec.decode_command(payload) == ((1.0, -1.0, 0.5), True)
    assert codec.command.counter(payload) == 0xFE
    assert codec.encode_command((999.0, -999.0, 0), False, 0).hex()[:8] == "2710d8f0"  # DBC limits


def test_a_message_of_odd_length_is_padded_and_unguarded(drive: Path) -> None:
    codec = load(drive, feedback_counter=("Currents.Half",))
    currents = codec.feedback[0]
    payload = currents.encode((1.0, 2.0, 3.0), 21)
    assert (len(payload), currents.counter(payload)) == (7, 5)
    assert codec.feedback[1].counter(b"\0\0") == 0
    assert currents.decode(payload + b"\0") is None


@pytest.mark.parametrize("least", [0, 1])
def test_a_counter_starts_over_where_its_range_in_the_dbc_ends(tmp_path: Path, least: int) -> None:
    text = HEADER + COMMAND.format(identifier=1) + FEEDBACK
    given = f"[{least}|{least + 14}]"
    path = write(tmp_path, text.replace("[0|255]", given).replace("(1,0) [0|0]", f"(1,0) {given}"))
    codec = load(path, command_counter="Command.Alive", feedback_counter=("Currents.Half",))
    sent = [codec.encode_command((0.0, 0.0, 0.0), True, number) for number in range(17)]
    assert [payload[7] for payload in sent] == [*range(least, least + 15), least, least + 1]
    assert [codec.command.counter(payload) for payload in sent] == [*range(15), 0, 1]
    assert codec.feedback[0].checks.counter_modulus == 15


def test_padding_to_a_length_that_can_fd_has(tmp_path: Path) -> None:
    text = HEADER + COMMAND.format(identifier=1).replace("Command: 8", "Command: 10") + FEEDBACK
    codec = load(write(tmp_path, text))
    payload = codec.encode_command((1.0, 2.0, 3.0), True, 0)
    assert len(payload) == 12
    assert codec.decode_command(payload) == ((1.0, 2.0, 3.0), True)


def test_extended_identifier(tmp_path: Path) -> None:
    text = HEADER + COMMAND.format(identifier=0x18FF0102 | EXTENDED) + FEEDBACK
    command = load(write(tmp_path, text)).command
    assert command.key == 0x18FF0102 | EXTENDED


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ({"command_enable": "Comand.Control"}, ["no message Comand", "did you mean Command?"]),
        ({"command_enable": "Command.Contrl"}, ["no signal Contrl", "did you mean Control?"]),
        ({"command_enable": "Command.Qqq"}, ["no signal Qqq", "it has RefA, RefB"]),
        ({"command_enable": "Control"}, ['must be written "Message.Signal"']),
        ({"command_enable": "Other.Count"}, ["must be in one message", "Command and Other"]),
        ({"command_counter": "Other.Count"}, ["Other.Count is not in Command"]),
        ({"command_constants": {"Other.Count": 1}}, ["Other.Count is not in Command"]),
        ({"feedback_u_bus_V": "State.Extra"}, ["multiplexed"]),
        ({"feedback_counter": ("Currents.A",)}, ["unsigned integer without scale"]),
        ({"feedback_counter": ("Currents.Scaled",)}, ["unsigned integer without scale"]),
        ({"feedback_crc": ("Currents.Half",)}, ["one whole byte"]),
        ({"feedback_crc": ("Other.Count",)}, ["not in Currents and State"]),
    ],
)
def test_what_the_dbc_lacks_is_named(
    drive: Path, names: dict[str, Any], expected: list[str]
) -> None:
    message = error_of(drive, **names)
    assert f"[inverter.can.signals] {next(iter(names))}:" in message
    for part in expected:
        assert part in message


def test_an_integer_whose_low_bits_would_be_lost(tmp_path: Path) -> None:
    """A value is a float: of 64 bits, the highest set, the lowest may be the fault."""
    text = HEADER + COMMAND.format(identifier=1) + FEEDBACK
    wide = 'BO_ 5 Wide: 8 Drive\n SG_ Word : 0|{}@1+ (1,0) [0|0] "" Host\n'
    names = {"feedback_status": "Wide.Word"}
    codec = load(write(tmp_path, text + wide.format(53)), **names)
    message = codec.feedback[1]
    assert message.decode((2**52 + 1).to_bytes(8, "little")) == (2**52 + 1,)
    path = write(tmp_path, text + wide.format(54))
    assert "Wide.Word must be an integer without scale, of 53 bits" in error_of(path, **names)


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        (("Currents: 7", "Currents: 100"), "Currents has 100 bytes, a CAN FD frame 64 at most"),
        (("(0.01,0) [-100", "(1E+400,0) [-100"), "a factor of inf"),
        (("(0.01,0) [-100", "(0.01,1E+400) [-100"), "an offset of inf"),
    ],
)
def test_what_no_frame_can_carry_is_refused(
    tmp_path: Path, wrong: tuple[str, str], expected: str
) -> None:
    text = HEADER + COMMAND.format(identifier=1) + FEEDBACK
    assert expected in error_of(write(tmp_path, text.replace(*wrong)))


def test_limits_beyond_every_number_are_none(tmp_path: Path) -> None:
    text = HEADER + COMMAND.format(identifier=1) + FEEDBACK
    codec = load(write(tmp_path, text.replace("[-100|100]", "[-100|1E+400]")))
    assert codec.command.steps("i_a_A")[1] == 327.67


def test_files_that_are_no_dbc(tmp_path: Path) -> None:
    assert "No such file" in error_of(tmp_path / "missing.dbc")
    assert "not a valid DBC: Invalid syntax at line 1" in error_of(write(tmp_path, "hello"))
    assert "has no message Command; it has none" in error_of(write(tmp_path, HEADER))
    overlong = HEADER + 'BO_ 1 Command: 1 Host\n SG_ RefA : 0|16@1- (1,0) [0|0] "" Drive\n'
    assert "does not fit" in error_of(write(tmp_path, overlong))


def test_a_long_message_needs_can_fd(tmp_path: Path) -> None:
    text = HEADER + COMMAND.format(identifier=1).replace("Command: 8", "Command: 12") + FEEDBACK
    assert "set fd = true" in error_of(write(tmp_path, text), fd=False)
