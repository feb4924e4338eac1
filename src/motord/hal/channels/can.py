"""Channels in CAN frames: signals of a DBC, from a bus that is listened to and never written."""

import math
import time

from motord.config import CanBusConfig, ChannelConfig, ConfigError
from motord.config.bounds import is_below, rounded_up
from motord.config.channel_sources import CanSource
from motord.config.timing import INTERVALS_MIN
from motord.hal.base import DeviceError
from motord.hal.can.base import CanBus
from motord.hal.can.bus import open_bus
from motord.hal.channel_source import RawSample
from motord.hal.channels.line_poller import OPEN_AGAIN_S
from motord.hal.loop_clock import LoopClock
from motord.wire.can.dbc import signal_codec


class ListeningPort:
    """The bus that several channels listen to, with the newest payload of each message.

    One that is silent for as long as the most patient of its channels waits, and for
    `OPEN_AGAIN_S`, has to be opened anew: of an adapter that was away and is back nothing comes,
    and no error either.
    """

    def __init__(self, config: CanBusConfig) -> None:
        self._config = config
        self._bus: CanBus | None = None
        self._keys: set[int] = set()
        self._clock = LoopClock()
        self._patience_s = OPEN_AGAIN_S
        self._received_ns = 0
        self._wrong = "not open"
        self.newest: dict[int, tuple[bytes, int]] = {}
        """By key: payload, and when it came (monotonic ns)."""

    def open(self, key: int, timeout_s: float) -> None:
        """Listen to messages of this key, too. Raises DeviceError."""
        self._keys.add(key)
        self._patience_s = max(self._patience_s, timeout_s)
        if self._bus is None:
            self._bus = open_bus(self._config, self._config.place)
            self._received_ns = time.monotonic_ns()
        self._bus.listen(self._keys)

    def pump(self) -> None:
        """Take what has come. Raises DeviceError for a bus that is off or has to be opened anew."""
        if self._bus is None:
            raise DeviceError(f"{self._config.place}: {self._wrong}")
        now_ns, stamped = time.monotonic_ns(), self._clock.from_system
        self._clock.observe(now_ns)
        while frames := self._bus.receive():
            self._received_ns = now_ns
            for key, payload, stamp_ns in frames:
                self.newest[key] = payload, stamped(stamp_ns) if stamp_ns else now_ns
        if self._bus.state.off:
            self._wrong = "the CAN controller is off the bus"
        elif now_ns - self._received_ns > round(self._patience_s * 1e9):
            self._wrong = (
                f"no message of its channels came for {self._patience_s:g} s; are adapter and "
                "sensor connected and on?"
            )
        else:
            return
        raise DeviceError(f"{self._config.place}: {self._wrong}")

    def close(self) -> None:
        """Leave the bus."""
        bus, self._bus = self._bus, None
        self.newest.clear()
        if bus is not None:
            bus.close()


class CanChannel:
    """A signal in frames that come by themselves."""

    def __init__(self, channel: ChannelConfig, port: ListeningPort) -> None:
        """Compile the signal of a channel's CanSource. Raises ConfigError."""
        source = channel.source
        assert isinstance(source, CanSource)
        self._port = port
        self._codec = signal_codec(source.dbc, source.signal)
        if why := channel.beyond_reach(*self._codec.steps(source.signal)[:2]):
            raise ConfigError(f"{source.dbc}: {source.signal} could never trip at {why}")
        least_s = INTERVALS_MIN * self._codec.cycle_s + channel.period_s
        if self._codec.cycle_s and is_below(channel.timeout_s, least_s):
            raise ConfigError(
                f"{source.dbc}: {source.signal} comes every {self._codec.cycle_s:g} s "
                f"(GenMsgCycleTime) and is read every {channel.period_s:g} s, and one may be lost: "
                f"timeout_s = {channel.timeout_s:g} would be over although the sensor is well; "
                f"make it at least {rounded_up(least_s):g}"
            )
        self._timeout_s = channel.timeout_s
        self._seen_ns = 0

    def open(self) -> None:
        """Open the bus, or join those who have. Raises DeviceError."""
        self._port.open(self._codec.key, self._timeout_s)

    def read(self) -> RawSample | None:
        """Return the signal in the newest frame, None if none has come since the last call.

        A frame of another length has no number. Raises DeviceError.
        """
        self._port.pump()
        payload, t_ns = self._port.newest.get(self._codec.key, (b"", 0))
        if t_ns <= self._seen_ns:
            return None
        self._seen_ns = t_ns
        values = self._codec.decode(payload)
        age_s = max(time.monotonic_ns() - t_ns, 0) * 1e-9
        return RawSample(math.nan if values is None else values[0], age_s)

    def close(self) -> None:
        """Leave the bus to be opened again."""
        self._port.close()
