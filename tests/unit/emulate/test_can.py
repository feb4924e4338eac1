import can
import pytest

from motord.config import load
from motord.emulate import EmulatorError
from motord.emulate.bench import CurrentCommand
from motord.emulate.can import CanPort
from motord.wire.can import dbc
from tests.unit.emulate.benches import EMULATED

CONFIG = load(EMULATED).inverter.can
CODEC = dbc.load(CONFIG)
CURRENTS = (5.0, -2.5, -2.5)


@pytest.fixture
def ends(request):
    """Yield (port, host) on a bus inside this process."""
    config = CONFIG.model_copy(
        update={"interface": "virtual", "channel": request.node.name, "options": {}}
    )
    port = CanPort(config, CODEC)
    with can.Bus(channel=request.node.name, interface="virtual") as host:
        yield port, host
    port.bus.close()


def command(counter, i_A=CURRENTS, enable=True, **changes):
    payload = CODEC.encode_command(i_A, enable, counter)
    fields = {
        "arbitration_id": CODEC.command.identifier,
        "is_extended_id": False,
        "is_fd": True,
        "data": payload,
    }
    return can.Message(**fields | changes)


def test_commands_come_with_their_time(ends):
    port, host = ends
    for counter in range(3):
        host.send(command(counter))
    received = list(port.receive())
    assert [c for _, c in received] == [CurrentCommand(CURRENTS, True)] * 3
    times_ns = [t for t, _ in received]
    assert times_ns == sorted(times_ns)
    assert list(port.receive()) == []
    assert port.check.errors == 0


def test_corrupt_repeated_and_foreign_frames_are_not_commands(ends):
    port, host = ends
    host.send(command(0))
    host.send(command(0))  # the same counter: a host that hangs
    host.send(command(1, data=bytes(8)))
    host.send(can.Message(arbitration_id=0x77, is_extended_id=False, data=bytes(8)))
    host.send(command(2, is_extended_id=True))
    host.send(command(2, is_error_frame=True))  # 0x100 is the class of a controller's restart
    assert len(list(port.receive())) == 1
    assert port.check.errors == 2


def test_feedback_is_numbered_and_can_be_read(ends):
    port, host = ends
    values = {slot: 0.0 for message in CODEC.feedback for slot in message.slots}
    values |= {"i_a_A": 1.5, "u_c_V": -3.0, "u_bus_V": 24.0, "status": 9.0}
    for _ in range(17):
        for message in CODEC.feedback:
            port.send(message, values)
    codecs = {message.identifier: message for message in CODEC.feedback}
    counters = {identifier: [] for identifier in codecs}
    for _ in range(17 * len(codecs)):
        message = host.recv(2)
        codec = codecs[message.arbitration_id]
        got = dict(zip(codec.slots, codec.decode(message.data), strict=True))
        assert got == pytest.approx({slot: values[slot] for slot in codec.slots}, abs=0.01)
        counters[message.arbitration_id].append(codec.counter(message.data))
    assert list(counters.values()) == [[*range(16), 0]] * len(codecs)


class Broken:
    """A bus whose every call fails."""

    def __init__(self):
        self.frames = 2

    def recv(self, _timeout):
        if self.frames:
            self.frames -= 1
            raise can.CanOperationError("junk")

    def send(self, _message, timeout):
        raise can.CanOperationError("no room")

    def shutdown(self):
        pass


def test_a_failing_bus_is_counted_and_survived(ends, monkeypatch):
    port, _ = ends
    port.bus.close()
    broken = Broken()
    monkeypatch.setattr(port.bus, "_bus", broken)
    assert list(port.receive()) == []
    port.send(CODEC.feedback[0], dict.fromkeys(CODEC.feedback[0].slots, 0.0))
    assert (broken.frames, port.bus.refused) == (0, 1)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"interface": "socketcan", "channel": "nocan7", "options": {}}, "socketcan nocan7"),
        ({"interface": "no-such-interface"}, "no-such-interface"),
        ({"channel": "not a group"}, "not a group"),
        ({"bitrate": 500_000, "data_bitrate": 2_000_000, "options": {"port": "x"}}, "ip route"),
    ],
)
def test_a_bus_that_cannot_be_opened_is_one_line(changes, expected):
    with pytest.raises(EmulatorError) as caught:
        CanPort(CONFIG.model_copy(update=changes), CODEC)
    assert expected in str(caught.value)
    assert "cannot open it" in str(caught.value)
    assert "\n" not in str(caught.value)


def drained(host):
    got = []
    while (message := host.recv(0)) is not None:
        got.append(message)
    return got


def test_faults_on_the_way_to_the_host(ends):
    port, host = ends
    codec = CODEC.feedback[0]
    values = dict.fromkeys(codec.slots, 0.0)
    port.faults.active, port.faults.duplicate = True, 1.0
    port.send(codec, values, 0)
    assert [bytes(m.data) for m in drained(host)] == [codec.encode([0.0] * len(codec.slots), 0)] * 2
    port.faults.clear()
    port.faults.active, port.faults.drop = True, 1.0
    port.send(codec, values, 0)
    assert drained(host) == []
    port.faults.clear()
    port.faults.active, port.faults.delay_ns = True, 5
    port.send(codec, values, 10)
    port.faults.clear()
    port.send(codec, values, 11)  # must not overtake the one that is late
    port.play(14)
    assert drained(host) == []
    port.play(15)
    assert [codec.counter(bytes(m.data)) for m in drained(host)] == [2, 3]


def test_faults_on_the_way_to_the_drive(ends):
    port, host = ends
    port.faults.active, port.faults.drop = True, 1.0
    host.send(command(0))
    assert list(port.receive()) == []
    port.faults.clear()
    port.faults.active, port.faults.corrupt = True, 1.0
    host.send(command(1))
    assert list(port.receive()) == []
    assert port.check.errors == 1
    port.faults.clear()
    host.send(command(2))
    assert len(list(port.receive())) == 1


def test_the_hosts_controller_notices_that_it_is_off_the_bus_and_back(ends):
    port, host = ends
    port.faults.active = port.faults.off = True
    port.play(0)
    port.play(1)
    [off] = drained(host)
    assert off.is_error_frame
    assert off.arbitration_id == 0x40
    port.faults.clear()
    port.play(2)
    [back] = drained(host)
    assert (back.is_error_frame, back.arbitration_id) == (True, 0x100)
