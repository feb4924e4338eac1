"""What the bridge's driver asks of a link, be it a serial port or CAN."""

from typing import Protocol

from motord.wire.bridge import frames


class BridgeLink(Protocol):
    """Frames to and from the board. No call waits but `wait`, and none raises."""

    stamp_ns: int
    """When the newest frame of the last `receive` came: Unix ns, 0 if the link has no stamps."""

    openings: int
    """How often it was opened: one more after it was away, and another board may be behind it."""

    @property
    def received(self) -> str:
        """Return what has arrived so far, as text: "" if nothing."""

    @property
    def errors(self) -> int:
        """Return the frames lost, corrupt or refused so far; it never falls."""

    def receive(self) -> list[frames.Numbered]:
        """Return the good frames that have arrived, the oldest first."""

    def send(self, frame: frames.Frame, number: int) -> None:
        """Send a frame."""

    def wait(self, timeout_s: float) -> None:
        """Wait until something has arrived, at most `timeout_s`. For opening, not for the loop."""

    def close(self) -> None:
        """Release the link; may be called twice."""
