"""The bridge board over a serial port (USB CDC or UART)."""

from motord.config import Config
from motord.config.devices import BridgeConfig
from motord.hal.bridge.board import Bridge
from motord.hal.bridge.serial_port import SerialPort
from motord.wire.bridge import frames
from motord.wire.bridge.stream import StreamDecoder


class SerialLink(SerialPort):
    """A `BridgeLink` on a serial port."""

    stamp_ns = 0

    def __init__(self, config: BridgeConfig) -> None:
        """Open the port. Raises DeviceError."""
        super().__init__(config.port, config.baud, "bridge")
        self._decoder = StreamDecoder()
        self._bytes = 0

    @property
    def received(self) -> str:
        """What has arrived so far, as text."""
        return f"{self._bytes} bytes of something else" if self._bytes else ""

    @property
    def errors(self) -> int:
        """Return the frames lost, corrupt or refused so far."""
        return self._decoder.errors + self.failures

    def receive(self) -> list[frames.Numbered]:
        """Return the good frames that have arrived."""
        data = self.read()
        self._bytes += len(data)
        return self._decoder.feed(data) if data else []

    def send(self, frame: frames.Frame, number: int) -> None:
        """Send a frame."""
        self.write(frames.encode(frame, number))


class SerialBridge(Bridge):
    """A `BridgeDriver` for a board on a serial port."""

    def __init__(self, config: Config) -> None:
        """Take port, rates and scales from `config`; nothing is opened."""
        bridge = config.bridge
        super().__init__(
            config,
            f"bridge on {bridge.port}",
            "is this port the bridge's, and is baud right?",
            lambda: SerialLink(bridge),
        )
