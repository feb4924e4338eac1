"""The supervisor's end of the process that reads the slow channels. No call waits for it."""

from collections.abc import Callable, Mapping
from typing import Any

from motord.config import ChannelConfig
from motord.service.bench.channels import ChannelMonitor
from motord.service.channels.protocol import ReadingsMessage
from motord.service.host.child_pipes import ChildPipes
from motord.service.host.children import Children
from motord.service.host.events import EventLog

CHANNELS = "channels"


class ChannelLink:
    """Passes readings on to the monitor, and to the recording.

    `record` takes the channel, the age of the reading (ns) and its content.
    """

    def __init__(
        self,
        monitor: ChannelMonitor,
        children: Children,
        events: EventLog,
        record: Callable[[ChannelConfig, int, Mapping[str, Any]], None],
    ) -> None:
        self._monitor = monitor
        self._record = record
        self._pipes = ChildPipes(CHANNELS, ReadingsMessage, children, events)

    def step(self, now_ns: int) -> None:
        """Take the readings that have come. `now_ns` is monotonic."""
        self._pipes.opened()
        for message in self._pipes.messages(now_ns):
            for one in message.readings:
                reading = one.reading(now_ns)
                if (channel := self._monitor.take(reading, now_ns)) is not None:
                    content = channel.content(now_ns)
                    self._record(channel.config, now_ns - reading.t_ns, content)
        if not self._pipes.closed():
            self._pipes.end_if_silent(now_ns)

    def stop(self) -> None:
        """End the process."""
        self._pipes.kill()
