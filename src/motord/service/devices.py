"""Brake and external drive: slow devices, asked one after the other in a thread of their own.

The supervisor sets `wanted` and reads `view()`; neither waits for a device. A device that stops
answering is `failing` at once, and `stale` when nothing was heard for its `stale_after_s`.
"""

import threading
import time
from collections.abc import Callable, Sequence

from motord.hal.base import DeviceError, DeviceReading, SetpointDevice
from motord.service.log import log_error
from motord.service.views import DeviceView, Health

JOIN_S = 5.0


class SlowDevice:
    """One device with its set-point. `exchange` is for the thread, the rest for the supervisor."""

    def __init__(
        self, name: str, device: SetpointDevice, poll_s: float, stale_after_s: float
    ) -> None:
        self.name = name
        self.wanted = 0.0
        self._device = device
        self._poll_ns = round(poll_s * 1e9)
        self._stale_ns = round(stale_after_s * 1e9)
        self._due_ns = 0
        self._heard_ns = 0  # monotonic; at first, when it was opened
        self._reading: DeviceReading | None = None
        self._error = ""

    def open(self, now_ns: int) -> None:
        """Connect. Raises DeviceError."""
        self._device.open()
        self._due_ns = self._heard_ns = now_ns

    def due_in_s(self, now_ns: int) -> float:
        """Return the time until the next exchange."""
        return max(0.0, (self._due_ns - now_ns) / 1e9)

    def exchange(self, clock_ns: Callable[[], int]) -> None:
        """Write the set-point and read the device; blocks at most its timeouts."""
        begun_ns = clock_ns()
        self._due_ns = max(self._due_ns + self._poll_ns, begun_ns)
        try:
            reading = self._device.exchange(self.wanted)
        except DeviceError as error:
            self._error = str(error)
            return
        except Exception as error:  # of a driver: the other device must still be served
            if not self._error:
                log_error(f"in the driver of the {self.name}", error)
            self._error = f"error in its driver: {type(error).__name__}: {error}"
            return
        self._reading, self._heard_ns, self._error = reading, clock_ns(), ""

    def close(self) -> None:
        """Write a set-point of zero, if the device can be reached, and disconnect."""
        self._device.safe_stop()
        self._device.close()

    def view(self, now_ns: int) -> DeviceView:
        """Return the device as clients see it."""
        reading, error = self._reading, self._error
        age_ns = now_ns - self._heard_ns
        health: Health = "stale" if age_ns > self._stale_ns else "failing" if error else "ok"
        return DeviceView(
            health=health,
            status=reading.status if reading else None,
            setpoint=reading.setpoint if reading else None,
            value=reading.value if reading else None,
            error=error,
            age_s=round(age_ns / 1e9, 3),
        )


class DeviceThread:
    """Polls slow devices until stopped."""

    def __init__(
        self,
        devices: Sequence[SlowDevice],
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._devices = devices
        self._clock_ns = clock_ns
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._poll, name="motord-devices", daemon=True)

    def start(self) -> None:
        """Start polling, if there is anything to poll."""
        if self._devices:
            self._thread.start()

    def stop(self) -> None:
        """End the polling; every device gets a set-point of zero and is closed."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(JOIN_S)
        for device in self._devices:
            device.close()

    def _poll(self) -> None:
        while True:
            now_ns = self._clock_ns()
            wait_s = min(device.due_in_s(now_ns) for device in self._devices)
            if self._stop.wait(wait_s):
                return
            for device in self._devices:
                if device.due_in_s(self._clock_ns()) == 0.0:
                    device.exchange(self._clock_ns)
