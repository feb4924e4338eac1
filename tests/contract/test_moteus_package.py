"""The shipped map of moteus against the vendor's own code: the package `moteus`.

Our command is decoded by `moteus.protocol`, the reply is made by its writers, on loopback.
"""

import io
import struct
import time
from collections.abc import Iterator

import can
import moteus
import numpy as np
import pytest
from moteus import multiplex as mp
from moteus import protocol
from moteus.protocol import Mode, Register

from motord.config import Config
from motord.hal.inverter.dq_currents import DqInverter
from motord.schema import InverterStatus
from motord.wire.can import dbc
from motord.wire.can.codec import InverterCodec
from motord.wire.can.frame_format import EXTENDED
from tests.contract.benches import new_command
from tests.contract.peers import Peer, until
from tests.contract.shipped_drives import command_along, feedback_of, shipped

CURRENTS_A = [(0.0, 0.0), (-1.5, 6.25), (3.0e-5, -41.7), (100.0, -100.0)]
ASKED = [
    (Register.MODE, mp.INT8),
    (Register.Q_CURRENT, mp.F32),
    (Register.D_CURRENT, mp.F32),
    (Register.VOLTAGE, mp.INT16),
    (Register.TEMPERATURE, mp.INT16),
    (Register.FAULT, mp.INT16),
]
"""What the command asks for, in this order."""


@pytest.fixture
def codec() -> InverterCodec:
    return codec_of(shipped("moteus"))


def codec_of(config: Config) -> InverterCodec:
    assert config.inverter.can is not None
    return dbc.load(config.inverter.can)


def reply(values: dict[int, float], asked: list[tuple[int, int]] = ASKED) -> bytes:
    """Return the frame in which a moteus answers: the vendor's writers, padded as for CAN FD."""
    buffer = io.BytesIO()
    writer = protocol.Writer(buffer)
    write = {
        Register.MODE: writer.write_int,
        Register.Q_CURRENT: writer.write_current,
        Register.D_CURRENT: writer.write_current,
        Register.VOLTAGE: writer.write_voltage,
        Register.TEMPERATURE: writer.write_temperature,
        Register.FAULT: writer.write_int,
    }
    groups: list[list[tuple[int, int]]] = []
    for register, resolution in asked:
        last = groups[-1][-1] if groups else (-9, -9)
        groups += [] if (register, resolution) == (last[0] + 1, last[1]) else [[]]
        groups[-1].append((register, resolution))
    for group in groups:
        combiner = mp.WriteCombiner(writer, mp.REPLY_BASE, group[0][0], [r for _, r in group])
        for register, resolution in group:
            assert combiner.maybe_write()
            write[Register(register)](values.get(register, 0), resolution)
    data = buffer.getvalue()
    size = next(each for each in (8, 12, 16, 20, 24, 32) if each >= len(data))
    return data.ljust(size, bytes([mp.NOP]))


@pytest.mark.parametrize(("i_d_A", "i_q_A"), CURRENTS_A)
@pytest.mark.parametrize(("enable", "mode"), [(True, Mode.CURRENT), (False, Mode.STOPPED)])
def test_every_field_of_the_command_is_as_the_vendor_reads_it(
    codec: InverterCodec, i_d_A: float, i_q_A: float, enable: bool, mode: Mode
) -> None:
    parsed = protocol.parse_registers(codec.encode_command((i_d_A, i_q_A), enable, 0))
    assert parsed.command == {
        Register.MODE: mode,
        Register.COMMAND_Q_CURRENT: pytest.approx(i_q_A, rel=1e-6),
        Register.COMMAND_D_CURRENT: pytest.approx(i_d_A, rel=1e-6),
    }
    assert parsed.query == ASKED
    assert not parsed.errors
    assert not parsed.response


@pytest.mark.parametrize(("i_d_A", "i_q_A"), CURRENTS_A)
def test_the_command_begins_as_the_vendors_own(
    codec: InverterCodec, i_d_A: float, i_q_A: float
) -> None:
    """`Controller.make_current` for ID 1, up to its own query; and the same identifier."""
    controller = moteus.Controller(id=1, transport=object())
    theirs = controller.make_current(d_A=i_d_A, q_A=i_q_A)
    ours = codec.encode_command((i_d_A, i_q_A), True, 0)
    assert ours.startswith(theirs.data)
    reply_wanted = 0x8000
    identifier = reply_wanted | (theirs.source << 8) | theirs.destination
    assert codec.command.key == identifier | EXTENDED


def test_the_length_is_one_of_can_fd_and_nothing_of_it_is_unread(codec: InverterCodec) -> None:
    payload = codec.encode_command((1.0, 2.0), True, 0)
    assert len(payload) == can.util.dlc2len(can.util.len2dlc(len(payload)))
    assert payload[-1] == mp.NOP
    read = sum(1 for each in mp.parse_frame(payload))
    assert read == 3 + len(ASKED)


@pytest.mark.parametrize(
    ("register", "value", "slot"),
    [
        (Register.MODE, 11, "status"),
        (Register.Q_CURRENT, -3.25, "i_q_A"),
        (Register.D_CURRENT, 0.625, "i_d_A"),
        (Register.VOLTAGE, 25.5, "u_bus_V"),
        (Register.TEMPERATURE, -8.4, "temperature_C"),
    ],
)
def test_a_register_of_the_reply_is_its_value_and_no_other(
    codec: InverterCodec, register: int, value: float, slot: str
) -> None:
    (message,) = codec.feedback
    payload = reply({register: value})
    assert protocol.parse_reply(payload)[register] == pytest.approx(value)
    values = dict(zip(message.slots, message.decode(payload) or (), strict=True))
    assert values.pop(slot) == pytest.approx(value, abs=1e-9)
    assert set(values.values()) == {0}
    assert message.identifier == 0x100  # from ID 1 to ID 0


STATUS = {
    Mode.CURRENT: InverterStatus.READY,
    Mode.FAULT: InverterStatus.FAULT,
    Mode.TIMEOUT: InverterStatus.COMMAND_TIMEOUT,
}


@pytest.mark.parametrize("mode", Mode)
def test_every_mode_of_the_vendor_has_its_status(codec: InverterCodec, mode: Mode) -> None:
    assert codec.decode_status(mode) == STATUS.get(mode, InverterStatus(0))


class Moteus(Peer):
    """A controller made of the vendor's code: decodes each frame, does what it says, answers it.

    It answers what was asked for, no more; in current mode the currents are those commanded.
    """

    def __init__(self, channel: str) -> None:
        self.registers = {Register.VOLTAGE: 24.0, Register.TEMPERATURE: 31.5, Register.MODE: 0}
        self.unknown: list[bytes] = []
        self.bus = can.Bus(channel, "virtual", ignore_config=True)
        super().__init__()

    def step(self) -> None:
        message = self.bus.recv(0.01)
        if message is None:
            return
        parsed = protocol.parse_registers(bytes(message.data))
        wants_reply, target = message.arbitration_id & 0x8000, message.arbitration_id & 0x7F
        if not (message.is_extended_id and message.is_fd and target == 1) or parsed.errors:
            self.unknown.append(bytes(message.data))
            return
        self.registers |= parsed.command
        driving = self.registers[Register.MODE] == Mode.CURRENT
        for actual, wanted in (
            (Register.Q_CURRENT, Register.COMMAND_Q_CURRENT),
            (Register.D_CURRENT, Register.COMMAND_D_CURRENT),
        ):
            self.registers[actual] = self.registers.get(wanted, 0.0) if driving else 0.0
        if wants_reply and parsed.query:
            answer = can.Message(
                arbitration_id=0x100,
                is_extended_id=False,
                is_fd=True,
                bitrate_switch=True,
                data=reply(self.registers, parsed.query),
            )
            self.bus.send(answer)

    def release(self) -> None:
        self.bus.shutdown()


@pytest.fixture
def bench() -> Iterator[tuple[DqInverter, Moteus, Config]]:
    config = shipped("moteus")
    assert config.inverter.can is not None
    device = Moteus(config.inverter.can.channel)
    driver = DqInverter(config)
    driver.open()
    yield driver, device, config
    driver.close()
    device.close()
    assert not device.unknown


def test_a_torque_command_there_and_back(bench: tuple[DqInverter, Moteus, Config]) -> None:
    """Position-free: q current alone, in current mode, and what flows is read back."""
    driver, device, config = bench
    command = command_along(config, 0.0, 3.5)

    def flows() -> np.ndarray | None:
        driver.write(command)
        feedback = feedback_of(driver, time.time_ns())
        return feedback if abs(feedback["i_A"][0]).max() > 1 else None

    feedback = until(flows)
    assert device.registers[Register.MODE] == Mode.CURRENT
    assert device.registers[Register.COMMAND_Q_CURRENT] == pytest.approx(3.5)
    assert device.registers[Register.COMMAND_D_CURRENT] == pytest.approx(0.0, abs=1e-6)
    assert Register.COMMAND_POSITION not in device.registers
    assert feedback["i_A"][0] == pytest.approx(command["i_A"][0], abs=1e-5)
    assert feedback["u_bus_V"][0] == pytest.approx(24.0)
    assert feedback["temperature_C"][0] == pytest.approx(31.5)
    assert feedback["inverter_status"][0] == InverterStatus.READY
    driver.write(new_command())
    until(lambda: device.registers[Register.MODE] == Mode.STOPPED)


def test_a_wrong_map_is_seen() -> None:
    """Currents exchanged, a register further, another mode: none of them passes for right."""
    heads = {"CurrentMode.WriteCurrents": 0x1D0E}
    for signals in (
        {"command_i_d_A": "CurrentMode.CurrentQ", "command_i_q_A": "CurrentMode.CurrentD"},
        {"command_constants": shipped("moteus").inverter.can.signals.command_constants | heads},
        {"command_enable_value": 10},
    ):
        payload = codec_of(shipped("moteus", **signals)).encode_command((-1.5, 6.25), True, 0)
        command = protocol.parse_registers(payload).command
        assert command != {
            Register.MODE: Mode.CURRENT,
            Register.COMMAND_Q_CURRENT: 6.25,
            Register.COMMAND_D_CURRENT: -1.5,
        }


def test_floats_are_those_of_the_wire(codec: InverterCodec) -> None:
    payload = codec.encode_command((-1.5, 6.25), True, 0)
    assert struct.pack("<f", 6.25) + struct.pack("<f", -1.5) in payload
