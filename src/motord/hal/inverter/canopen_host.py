"""What a CANopen drive wants of its host besides the command: NMT start, SYNC, heartbeats."""

from motord.config import CanopenConfig
from motord.hal.can.base import CanBus
from motord.wire.can.frame_format import SYNC, heartbeat, nmt_start


class CanopenHost:
    """Sends what `[inverter.can.canopen]` asks for; heartbeats come from the loop's own writes."""

    def __init__(self, config: CanopenConfig) -> None:
        node, host = config.start_node, config.heartbeat_node
        self._start = nmt_start(node) if node is not None else None
        self._sync = SYNC if config.sync else None
        self._heartbeat = heartbeat(host) if host is not None else None
        self._period_ns = round(config.heartbeat_s * 1e9)
        self._sent_ns = 0

    def start(self, bus: CanBus) -> None:
        """Have the node become operational; a node that is so already stays so."""
        if self._start is not None:
            bus.send(*self._start)

    def after_command(self, bus: CanBus, now_ns: int) -> None:
        """Put the command in force, and show that the host is there once in a period."""
        if self._sync is not None:
            bus.send(*self._sync)
        if self._heartbeat is None or 0 <= now_ns - self._sent_ns < self._period_ns:
            return
        bus.send(*self._heartbeat)
        self._sent_ns = now_ns
