"""NMT start, SYNC and heartbeats: which frames go with a command, and when."""

from motord.config import CanopenConfig
from motord.hal.inverter.can_drive import CanopenHost

SYNC = (0x80, b"")
BEAT = (0x700 + 9, b"\x05")


class Bus:
    def __init__(self) -> None:
        self.sent: list[tuple[int, bytes]] = []

    def send(self, key: int, payload: bytes) -> None:
        self.sent.append((key, payload))


def sent(now_ns: list[int], **changes: object) -> list[tuple[int, bytes]]:
    host, bus = CanopenHost(CanopenConfig.model_validate(changes)), Bus()
    host.start(bus)
    for each in now_ns:
        host.after_command(bus, each)
    return bus.sent


def test_nothing_unless_it_is_asked_for() -> None:
    assert sent([0, 10**9, 2 * 10**9]) == []


def test_the_node_is_started_and_all_nodes_by_zero() -> None:
    assert sent([], start_node=5) == [(0, b"\x01\x05")]
    assert sent([], start_node=0) == [(0, b"\x01\x00")]


def test_sync_follows_each_command() -> None:
    assert sent([1, 2, 3], sync=True) == [SYNC] * 3


def test_a_heartbeat_in_a_period_and_with_a_command_only() -> None:
    times_ns = [10**9 + ms * 10**6 for ms in (0, 19, 20, 30, 39, 40, 500)]
    assert sent(times_ns, heartbeat_node=9, heartbeat_s=0.02) == [BEAT] * 4
    assert sent([], heartbeat_node=9) == []


def test_a_clock_that_was_set_back_does_not_silence_them() -> None:
    assert sent([10**18, 5], heartbeat_node=9) == [BEAT, BEAT]


def test_sync_comes_before_the_heartbeat() -> None:
    assert sent([10**9], sync=True, heartbeat_node=9) == [SYNC, BEAT]
