"""The emulated inverter's CAN port: command frames in, feedback and status frames out."""

from collections.abc import Iterator, Mapping

from motord.can_interface import new_message, open_interface, opening_hint
from motord.config import CanBusConfig, CanConfig
from motord.emulate import EmulatorError
from motord.emulate.bench import CurrentCommand
from motord.emulate.devices import NEVER_NS
from motord.emulate.disturbance import Disturbance
from motord.python_can import can
from motord.wire.can.codec import InverterCodec, MessageCodec
from motord.wire.can.frame_format import ERROR_BUS_OFF, ERROR_RESTARTED, EXTENDED
from motord.wire.sequence import AliveCounter

FRAMES_AT_ONCE = 4096


class EmulatedBus:
    """A CAN channel that an emulated device is on, disturbed by `faults`.

    `refused` counts the frames that the bus had no room for.
    """

    def __init__(self, config: CanBusConfig, faults: Disturbance) -> None:
        """Open the channel. Raises EmulatorError."""
        self.refused = 0
        self._faults = faults
        try:
            self._bus = open_interface(config)
        except OSError as error:
            raise EmulatorError(
                f"CAN {config.place}: cannot open it: {error.strerror}; {opening_hint(config)}"
            ) from error

    def fileno(self) -> int:
        """Return the descriptor that is readable when something has come, -1 if there is none."""
        try:
            return self._bus.fileno()
        except NotImplementedError:
            return -1

    def receive(self, key: int) -> Iterator[tuple[int, bytes]]:
        """Yield the payloads with `key` since the last call, each with its arrival (Unix ns)."""
        for _ in range(FRAMES_AT_ONCE):
            try:
                message = self._bus.recv(0)
            except can.CanError:
                continue
            if message is None:
                return
            if message.is_error_frame or message.is_remote_frame:
                continue
            if message.arbitration_id | (EXTENDED if message.is_extended_id else 0) != key:
                continue
            payload: bytes | None = bytes(message.data)
            if self._faults.active:
                payload = self._faults.to_device(bytes(message.data))
            if payload is not None:
                yield round(message.timestamp * 1e9), payload

    def send(self, message: can.Message) -> None:
        """Send a frame; what the bus has no room for is lost and counted."""
        try:
            self._bus.send(message, timeout=0)
        except can.CanError:
            self.refused += 1

    def close(self) -> None:
        """Release the channel; may be called twice."""
        self._bus.shutdown()


class CanPort:
    """The drive's end of the bus. Commands with a wrong CRC or an old counter are ignored.

    `check` counts the commands that were lost, corrupt or old.
    """

    def __init__(self, config: CanConfig, codec: InverterCodec) -> None:
        """Open the bus. Raises EmulatorError."""
        self.faults = Disturbance()
        self._was_off = False
        self._codec = codec
        self.check = AliveCounter(codec.command.checks.counter_modulus)
        self._outgoing = {m.name: _Outgoing(m, config.fd) for m in codec.feedback}
        self.bus = EmulatedBus(config, self.faults)

    def receive(self) -> Iterator[tuple[int, CurrentCommand]]:
        """Yield the commands since the last call, each with its time of arrival (Unix ns)."""
        for at_ns, payload in self.bus.receive(self._codec.command.key):
            command = self._decode(payload)
            if command is not None:
                yield at_ns, command

    def _decode(self, payload: bytes) -> CurrentCommand | None:
        decoded = self._codec.decode_command(payload)
        if decoded is None:
            self.check.corrupt()
            return None
        if not self.check.accept(self._codec.command.counter(payload)):
            return None
        (i_a_A, i_b_A, i_c_A), enable = decoded
        return CurrentCommand((i_a_A, i_b_A, i_c_A), enable)

    def send(self, codec: MessageCodec, values: Mapping[str, float], now_ns: int = 0) -> None:
        """Send a feedback message; what the bus has no room for is lost and counted.

        `now_ns` (monotonic) matters to frames that a fault makes late.
        """
        message = self._outgoing[codec.name].fill(values)
        if not self.faults.active and self.faults.next_ns == NEVER_NS:
            self.bus.send(message)
            return
        for payload in self.faults.to_host(now_ns, codec.name, bytes(message.data)):
            message.data = bytearray(payload)
            self.bus.send(message)

    def play(self, now_ns: int) -> None:
        """Send late frames that are due, and an error frame if the host's controller goes off."""
        for name, payload in self.faults.due(now_ns):
            self.bus.send(self._outgoing[name].late(payload))
        if self.faults.off != self._was_off:
            self._was_off = self.faults.off
            self.bus.send(
                can.Message(
                    arbitration_id=ERROR_BUS_OFF if self._was_off else ERROR_RESTARTED,
                    is_extended_id=False,
                    is_error_frame=True,
                    data=bytes(8),
                )
            )


class _Outgoing:
    """A message to be sent again and again, with its counter."""

    def __init__(self, codec: MessageCodec, fd: bool) -> None:
        self._codec = codec
        self._counter = 0
        self._message = new_message(codec.key, fd=fd, data=bytes(codec.size_bytes))

    def fill(self, values: Mapping[str, float]) -> can.Message:
        codec = self._codec
        payload = codec.encode([values[slot] for slot in codec.slots], self._counter)
        self._counter = (self._counter + 1) % (codec.checks.counter_modulus or 1)
        self._message.data = bytearray(payload)
        return self._message

    def late(self, payload: bytes) -> can.Message:
        """Return the message with what it should have carried before."""
        self._message.data = bytearray(payload)
        return self._message
