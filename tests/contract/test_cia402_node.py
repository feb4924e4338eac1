"""The shipped map of CiA 402 against an independent implementation: `canopen`.

The device is canopen's local node with the objects of the profile; a remote node of canopen sets
it up over SDO as docs/drives.md wants it, before the driver is opened.
"""

import random
import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import can
import canopen
import numpy as np
import pytest
from canopen.objectdictionary import ODRecord, ODVariable, datatypes
from canopen.pdo.base import PdoMap
from canopen.profiles.p402 import OperationMode, State402

from motord.config import Config
from motord.hal.base import DeviceError
from motord.hal.inverter.dq_currents import DqInverter
from motord.schema import InverterStatus
from motord.wire.can import dbc
from motord.wire.can.codec import InverterCodec
from motord.wire.can.frame_format import nmt_start
from tests.contract.benches import new_command
from tests.contract.peers import until
from tests.contract.shipped_drives import command_along, feedback_of, shipped

NODE = 1
CONTROLWORD, STATUSWORD, MODE = 0x6040, 0x6041, 0x6060
TARGET_TORQUE, TORQUE_ACTUAL, LINK_VOLTAGE = 0x6071, 0x6077, 0x6079
OBJECTS = {
    CONTROLWORD: datatypes.UNSIGNED16,
    STATUSWORD: datatypes.UNSIGNED16,
    MODE: datatypes.INTEGER8,
    TARGET_TORQUE: datatypes.INTEGER16,
    TORQUE_ACTUAL: datatypes.INTEGER16,
    LINK_VOLTAGE: datatypes.UNSIGNED32,
    0x1017: datatypes.UNSIGNED16,
}


def dictionary() -> canopen.ObjectDictionary:
    """The objects of the profile that the map needs, and two PDOs each way."""
    od = canopen.ObjectDictionary()
    for index, kind in OBJECTS.items():
        od.add_object(variable(f"{index:04X}h", index, 0, kind))
    for com, mapping, cob in (
        (0x1400, 0x1600, 0x200), (0x1800, 0x1A00, 0x180), (0x1801, 0x1A01, 0x280)
    ):  # fmt: skip
        record = ODRecord(f"PDO {com:04X}h", com)
        for sub, kind, value in (
            (0, datatypes.UNSIGNED8, 5),
            (1, datatypes.UNSIGNED32, 1 << 31 | cob | NODE),
            (2, datatypes.UNSIGNED8, 1),
            (3, datatypes.UNSIGNED16, 0),
            (5, datatypes.UNSIGNED16, 0),
        ):
            record.add_member(variable(f"{com:04X}h {sub}", com, sub, kind, value))
        od.add_object(record)
        entries = ODRecord(f"mapping {mapping:04X}h", mapping)
        entries.add_member(variable(f"{mapping:04X}h 0", mapping, 0, datatypes.UNSIGNED8))
        for sub in range(1, 5):
            entries.add_member(
                variable(f"{mapping:04X}h {sub}", mapping, sub, datatypes.UNSIGNED32)
            )
        od.add_object(entries)
    return od


def variable(name: str, index: int, sub: int, kind: int, value: int = 0) -> ODVariable:
    """A variable that can be read, written and mapped."""
    made = ODVariable(name, index, sub)
    made.data_type, made.default, made.access_type, made.pdo_mappable = kind, value, "rw", True
    return made


@dataclass
class Cia402:
    """A drive of the profile: canopen's local node, its state machine by canopen's own table.

    PDOs count in the NMT state operational alone; those of transmission type 1 at SYNC. `strict`:
    it takes no two transitions at one control word.
    """

    channel: str
    strict: bool = False
    state: str = "SWITCH ON DISABLED"
    states: list[str] = field(default_factory=list)
    received: int = 0

    def __post_init__(self) -> None:
        self.network = canopen.Network()
        self.network.NOTIFIER_CYCLE = 0.02
        self.network.connect(channel=self.channel, interface="virtual")
        self.node = canopen.LocalNode(NODE, dictionary())
        self.network.add_node(self.node)
        self.node.nmt.send_command(0)  # booted up: pre-operational
        self.network.subscribe(0x200 + NODE, self._on_rpdo)
        self._pending: bytes | None = None
        self.network.subscribe(0x80, lambda *_: self._on_sync())
        self._set(STATUSWORD, State402.SW_MASK[self.state][1])
        self._set(LINK_VOLTAGE, 23_900)

    def _set(self, index: int, value: int) -> None:
        self.node.sdo[index].raw = value

    def value(self, index: int) -> int:
        return int(self.node.sdo[index].raw)

    @property
    def operational(self) -> bool:
        return bool(self.node.nmt.state == "OPERATIONAL")

    def _on_rpdo(self, _: int, data: bytearray, __: float) -> None:
        rpdo = self.node.rpdo[1]
        if not self.operational:
            return
        if rpdo.cob_id is None:
            self.node.rpdo.read()
            self.node.tpdo.read()
        self._pending = bytes(data)
        if rpdo.trans_type is not None and rpdo.trans_type >= 254:
            self._on_sync()

    def _on_sync(self) -> None:
        if self._pending is None or not self.operational:
            return
        rpdo, data, self._pending = self.node.rpdo[1], self._pending, None
        assert rpdo.length == 8 * len(data), "a PDO of another length than what is mapped"
        rpdo.data = bytearray(data)
        for entry in rpdo.map:
            self._set(entry.index, entry.raw)
        self.received += 1
        self._obey(self.value(CONTROLWORD))
        self.speak()

    def _obey(self, word: int) -> None:
        """Take the transition that canopen's table has for the control word.

        "Switch on and enable operation" is transition 3 and, unless `strict`, 4 after it.
        """
        both = word == State402.CW_OPERATION_ENABLED and not self.strict
        if both and self.state == "READY TO SWITCH ON":
            self._go(State402.CW_SWITCH_ON)
        self._go(word)
        self._set(STATUSWORD, State402.SW_MASK[self.state][1])
        enabled = self.state == "OPERATION ENABLED"
        torque_mode = self.value(MODE) == OperationMode.PROFILED_TORQUE
        self._set(TORQUE_ACTUAL, self.value(TARGET_TORQUE) if enabled and torque_mode else 0)

    def _go(self, word: int) -> None:
        for (origin, target), command in State402.TRANSITIONTABLE.items():
            if origin == self.state and word == command != 0:
                self.state = target
                self.states.append(target)
                return

    def speak(self) -> None:
        """Send both TPDOs, as an event timer would."""
        for number in (1, 2):
            tpdo: PdoMap = self.node.tpdo[number]
            if tpdo.enabled:
                for entry in tpdo.map:
                    entry.raw = self.value(entry.index)
                tpdo.transmit()

    def close(self) -> None:
        self.network.disconnect()


def commission(channel: str, trans_type: int = 255) -> None:
    """Set the drive up by SDO from another node: mapping, torque mode."""
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.02
    network.connect(channel=channel, interface="virtual")
    remote = canopen.RemoteNode(NODE, dictionary())
    network.add_node(remote)
    for pdo, indices in (
        (remote.rpdo[1], (CONTROLWORD, TARGET_TORQUE)),
        (remote.tpdo[1], (STATUSWORD, TORQUE_ACTUAL)),
        (remote.tpdo[2], (LINK_VOLTAGE,)),
    ):
        pdo.read()
        pdo.clear()
        for index in indices:
            pdo.add_variable(index)
        pdo.trans_type, pdo.enabled = trans_type, True
        pdo.save()
    remote.sdo[MODE].raw = OperationMode.PROFILED_TORQUE
    network.disconnect()


@dataclass
class Bench:
    config: Config
    device: Cia402
    driver: DqInverter


def channel_of(config: Config) -> str:
    assert config.inverter.can is not None
    return config.inverter.can.channel


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    changes = getattr(request, "param", {})
    config = shipped("cia402", changes.get("canopen"), **changes.get("signals", {}))
    device = Cia402(channel_of(config), strict=changes.get("strict", False))
    commission(channel_of(config), changes.get("trans_type", 255))
    driver = DqInverter(config)
    yield Bench(config, device, driver)
    driver.close()
    device.close()


@pytest.fixture
def codec() -> InverterCodec:
    can_config = shipped("cia402").inverter.can
    assert can_config is not None
    return dbc.load(can_config)


def test_a_torque_command_there_and_back(bench: Bench) -> None:
    """Position-free: 3.5 A of q current, to a thousandth of the rated current of 20 A."""
    bench.driver.open()
    command = command_along(bench.config, 0.0, 3.5)

    def flows() -> np.ndarray | None:
        bench.driver.write(command)
        feedback = feedback_of(bench.driver, time.time_ns())
        return feedback if abs(feedback["i_A"][0]).max() > 1 else None

    feedback = until(flows)
    assert bench.device.states == ["READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED"]
    assert bench.device.value(TARGET_TORQUE) == 175  # 3.5 A of 20 A, in thousandths
    assert feedback["i_A"][0] == pytest.approx(command["i_A"][0], abs=0.02)
    assert feedback["u_bus_V"][0] == pytest.approx(23.9)
    assert feedback["inverter_status"][0] == InverterStatus.READY
    bench.driver.write(new_command())
    until(lambda: bench.device.states[-1] == "READY TO SWITCH ON")
    assert bench.device.value(TARGET_TORQUE) == 0


@pytest.mark.parametrize("i_q_A", [-20.0, -0.02, 0.0, 0.02, 7.77, 20.0])
def test_every_field_of_the_command_is_as_canopen_reads_it(
    codec: InverterCodec, i_q_A: float
) -> None:
    """The codec takes what is in the drive's unit: thousandths of rated torque."""
    node = canopen.RemoteNode(NODE, dictionary())
    rpdo = node.rpdo[1]
    for index in (CONTROLWORD, TARGET_TORQUE):
        rpdo.add_variable(index)
    rpdo.data = bytearray(codec.encode_command((0.0, 50 * i_q_A), True, 0))
    assert rpdo.length == 8 * len(rpdo.data)
    assert rpdo[CONTROLWORD].raw == State402.CW_OPERATION_ENABLED
    assert rpdo[TARGET_TORQUE].raw == round(50 * i_q_A)
    rpdo.data = bytearray(codec.encode_command((0.0, 0.0), False, 0))
    assert rpdo[CONTROLWORD].raw == State402.CW_SHUTDOWN
    assert codec.command.identifier == rpdo.predefined_cob_id


def test_every_field_of_the_feedback_is_as_canopen_writes_it(codec: InverterCodec) -> None:
    node = canopen.RemoteNode(NODE, dictionary())
    values = {STATUSWORD: 0x1637, TORQUE_ACTUAL: -321, LINK_VOLTAGE: 400_123}
    expected = {"status": 0x1637, "i_q_A": -321, "u_bus_V": 400.123}
    messages = {message.identifier: message for message in codec.feedback}
    for number, indices in ((1, (STATUSWORD, TORQUE_ACTUAL)), (2, (LINK_VOLTAGE,))):
        tpdo = node.tpdo[number]
        for index in indices:
            tpdo.add_variable(index)
        tpdo._update_data_size()
        for index in indices:
            tpdo[index].raw = values[index]
        message = messages.pop(tpdo.predefined_cob_id)
        found = dict(zip(message.slots, message.decode(bytes(tpdo.data)) or (), strict=True))
        assert found == pytest.approx({slot: expected[slot] for slot in message.slots})
    assert not messages


STATUS = {
    "OPERATION ENABLED": InverterStatus.READY,
    "FAULT": InverterStatus.FAULT,
    "FAULT REACTION ACTIVE": InverterStatus.FAULT,
}


@pytest.mark.parametrize("state", State402.SW_MASK)
def test_every_state_of_the_profile_has_its_status(codec: InverterCodec, state: str) -> None:
    """Whatever the bits say that do not belong to the state."""
    mask, value = State402.SW_MASK[state]
    draw = random.Random(state)
    for _ in range(50):
        word = value | draw.getrandbits(16) & ~mask
        assert codec.decode_status(word) == STATUS.get(state, InverterStatus(0)), f"{word:#06x}"


def drives(bench: Bench) -> None:
    """Command until the drive is enabled and makes torque."""
    bench.driver.open()

    def makes_torque() -> bool:
        bench.driver.write(command_along(bench.config, 0.0, 1.0))
        feedback_of(bench.driver, time.time_ns())
        return bench.device.value(TORQUE_ACTUAL) == 50

    until(makes_torque)


@pytest.mark.parametrize("bench", [{"canopen": {}}], indirect=True)
def test_without_nmt_start_there_is_no_feedback_and_the_driver_says_so(bench: Bench) -> None:
    content = bench.config.model_dump()
    content["inverter"]["can"]["connect_timeout_s"] = 0.2
    with pytest.raises(DeviceError, match=r"no Transmit\d .* within 0.2 s, nothing at all"):
        DqInverter(Config.model_validate(content)).open()
    assert bench.device.received == 0
    assert bench.device.state == "SWITCH ON DISABLED"


@pytest.mark.parametrize(
    "bench",
    [
        {"canopen": {"start_node": 0}},
        {"canopen": {"start_node": 1, "sync": True}, "trans_type": 1},
        {"canopen": {"start_node": 1, "sync": True}, "trans_type": 0},
    ],
    indirect=True,
)
def test_nmt_starts_the_node_and_sync_puts_the_command_in_force(bench: Bench) -> None:
    drives(bench)
    assert bench.device.operational


@pytest.mark.parametrize("bench", [{"canopen": {"start_node": 1}, "trans_type": 1}], indirect=True)
def test_without_sync_a_command_that_waits_for_it_is_never_in_force(bench: Bench) -> None:
    content = bench.config.model_dump()
    content["inverter"]["can"]["connect_timeout_s"] = 0.2
    with pytest.raises(DeviceError, match="nothing at all"):
        DqInverter(Config.model_validate(content)).open()
    assert bench.device.operational
    assert bench.device._pending is not None
    assert bench.device.received == 0


def test_the_start_of_another_node_does_not_start_this_one() -> None:
    config = shipped("cia402", {"start_node": 2})
    device = Cia402(channel_of(config))
    with can.Bus(channel_of(config), "virtual", ignore_config=True) as other:
        for node in (2, NODE):
            assert not device.operational
            key, payload = nmt_start(node)
            other.send(can.Message(arbitration_id=key, is_extended_id=False, data=payload))
    until(lambda: device.operational)
    device.close()


@pytest.mark.parametrize(
    "bench", [{"canopen": {"start_node": 1, "heartbeat_node": 100}}], indirect=True
)
def test_heartbeats_are_as_canopen_reads_them(bench: Bench) -> None:
    host = canopen.RemoteNode(100, canopen.ObjectDictionary())
    bench.device.network.add_node(host)
    beats: list[int] = []
    host.nmt.add_heartbeat_callback(beats.append)
    drives(bench)
    until(lambda: host.nmt.state == "OPERATIONAL")
    before, now_ns = len(beats), time.time_ns()
    for second in (1, 2, 3):  # of the loop's time
        feedback_of(bench.driver, now_ns + second * 10**9)
        bench.driver.write(new_command())
        bench.driver.write(new_command())
    until(lambda: len(beats) >= before + 3)
    assert set(beats) == {5}


@pytest.mark.parametrize("bench", [{"strict": True}], indirect=True)
def test_a_drive_that_takes_one_transition_at_a_time_is_not_enabled(bench: Bench) -> None:
    """000Fh from "ready to switch on" is two: docs/drives.md asks for a drive that takes both."""
    bench.driver.open()
    received = bench.device.received

    def more() -> bool:
        bench.driver.write(command_along(bench.config, 0.0, 1.0))
        return bench.device.received > received + 5

    until(more)
    assert bench.device.states == ["READY TO SWITCH ON"]


@pytest.mark.parametrize(
    "bench",
    [{"signals": {"command_enable_value": 7}}, {"signals": {"command_disable_value": 0}}],
    indirect=True,
)
def test_a_wrong_control_word_does_not_enable(bench: Bench) -> None:
    bench.driver.open()
    received = bench.device.received

    def more() -> bool:
        bench.driver.write(command_along(bench.config, 0.0, 1.0))
        return bench.device.received > received + 5

    until(more)
    assert "OPERATION ENABLED" not in bench.device.states
