"""Brake and external drive: slow devices, each with a thread of its own.

The supervisor gives an `Order` at every step and reads `view()`; neither waits for a device. An
order expires, and the thread writes nothing else: if the supervisor hangs, the device is made safe
once and then written no more, so that its own watchdog takes over if that write does not arrive.
One without a watchdog is made safe until it answers that its set-point is zero.

A device that stops answering is `failing` at once, and `stale` after its `stale_after_s`.
"""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from motord.api.messages import DeviceView, Health
from motord.hal.base import DeviceError, DeviceReading, SetpointDevice
from motord.process.ending_threads import start_thread
from motord.service.host.events import REPORT_AGAIN_NS, EventLog
from motord.service.host.log import log_error
from motord.unix_clock import suspended_ns

JOIN_S = 5.0
SUSPENDED_NS = 500_000_000
"""A supervisor that did not run for this long says so, and stops the external drive. After as long
a suspension of the computer no order of before is written, and a powered bench is stopped."""
UNORDERED = "not written: the supervisor has given no order in time"


@dataclass(frozen=True, slots=True)
class Order:
    """A set-point and the time (monotonic ns) until which it may be written."""

    value: float
    until_ns: int

    def at(self, now_ns: int) -> float | None:
        """Return the set-point to write now, None once the order has expired."""
        return self.value if now_ns < self.until_ns else None


class SlowDevice:
    """One device with its set-point. `exchange` is for its thread, the rest for the supervisor.

    An order expires after `setpoint_valid_s`. `hold_s` later the device is made safe, by a
    set-point of zero; between the two it is left as it is. watchdog: it has one of its own, which
    requests that it refuses may feed, too.
    """

    def __init__(
        self,
        name: str,
        device: SetpointDevice,
        poll_s: float,
        stale_after_s: float,
        setpoint_valid_s: float,
        hold_s: float = 0.0,
        *,
        watchdog: bool,
    ) -> None:
        self.name = name
        self._order = Order(0.0, 0)
        self._device = device
        self._poll_ns = round(poll_s * 1e9)
        self.stale_after_s = stale_after_s
        self._order_ns = round(setpoint_valid_s * 1e9)
        self._hold_ns = round(hold_s * 1e9)
        self._watchdog = watchdog
        self._safe = self._ordered = False
        self._due_ns = 0
        self._answered_ns = 0  # monotonic; at first, when polling began
        self._reading: DeviceReading | None = None
        self._error = ""

    def open(self, now_ns: int) -> None:
        """Connect. Raises DeviceError."""
        self._device.open()
        self.begin(now_ns)

    def begin(self, now_ns: int) -> None:
        """Poll from now on: its silence before that is no fault."""
        self._due_ns = self._answered_ns = now_ns

    def order(self, value: float, now_ns: int) -> None:
        """Let `value` be the set-point for `setpoint_valid_s` from `now_ns` on."""
        self._order = Order(value, now_ns + self._order_ns)

    def withhold(self, now_ns: int) -> None:
        """End the order now: until the next one the device is made safe, as if it had expired."""
        if self._order.at(now_ns) is not None:
            self._order = Order(0.0, now_ns)

    def due_in_s(self, now_ns: int) -> float:
        """Return the time until the next exchange."""
        return max(0.0, (self._due_ns - now_ns) / 1e9)

    def exchange(self, clock_ns: Callable[[], int]) -> None:
        """Write the set-point and read the device; blocks at most its timeouts."""
        begun_ns = clock_ns()
        self._due_ns = max(self._due_ns + self._poll_ns, begun_ns)
        order = self._order
        setpoint = order.at(begun_ns)
        try:
            if setpoint is None:
                self._make_safe(begun_ns - order.until_ns)
                return
            self._safe, self._ordered = False, True
            reading = self._device.exchange(setpoint)
        except DeviceError as error:
            self._error = str(error)
            return
        except BaseException as error:  # of a driver: the other device must still be served
            if not self._error:
                log_error(f"in the driver of the {self.name}", error)
            self._error = f"error in its driver: {type(error).__name__}: {error}"
            return
        self._reading, self._answered_ns, self._error = reading, clock_ns(), ""

    def _make_safe(self, over_ns: int) -> None:
        """Make the device safe, `hold_s` after the order was over: once, or until it answers."""
        if not self._safe and over_ns >= self._hold_ns:
            self._safe = self._watchdog
            self._device.safe_stop()
            if not self._watchdog:
                reading = self._reading = self._device.exchange(0.0)
                self._safe = not reading.setpoint
        self._error = UNORDERED if self._ordered else ""  # at first the supervisor still starts

    def close(self) -> None:
        """Write a set-point of zero, if the device can be reached, and disconnect."""
        self._device.safe_stop()
        self._device.close()

    def view(self, now_ns: int) -> DeviceView:
        """Return the device as published."""
        reading, error = self._reading, self._error
        age_ns = max(0, now_ns - self._answered_ns)  # it may have answered since
        stale = age_ns > 1e9 * self.stale_after_s
        health: Health = "stale" if stale else "failing" if error else "ok"
        if stale and not error:
            error = UNORDERED if self._order.at(now_ns) is None else "its driver does not return"
        return DeviceView(
            health=health,
            status=reading.status if reading else None,
            setpoint=reading.setpoint if reading else None,
            value=reading.value if reading else None,
            error=error,
            age_s=round(age_ns / 1e9, 3),
        )


class DeviceHealth:
    """Follows the slow devices by name ("brake", "drive"). Times are monotonic ns."""

    def __init__(
        self, devices: Mapping[str, SlowDevice], brake_max_C: float, events: EventLog
    ) -> None:
        self._devices = devices
        self._brake_max_C = brake_max_C
        self._events = events
        self._reported: dict[str, tuple[Health, int]] = dict.fromkeys(devices, ("ok", 0))

    def look(self, now_ns: int, *, drive_turns: bool) -> tuple[str, str]:
        """Report changes; return why there may be no power, and why a drive at rest may not turn.

        Both "" for nothing. A drive that is stale matters to the torque only while it turns.
        """
        fault = idle = ""
        for name, device in self._devices.items():
            view = device.view(now_ns)
            self._report(name, view, now_ns)
            if view.health == "stale":
                stale = f"{name} has not answered for {device.stale_after_s:g} s: {view.error}"
                if name == "brake" or drive_turns:
                    fault = fault or stale
                else:
                    idle = stale
            if name == "brake" and view.value is not None and view.value > self._brake_max_C:
                fault = fault or (
                    f"the brake is at {view.value:.0f} degC, above [brake] "
                    f"temperature_max_C = {self._brake_max_C:g}"
                )
        return fault, idle

    def _report(self, name: str, view: DeviceView, now_ns: int) -> None:
        """Make an event of another health, but soon after the last one only if it is stale."""
        health, reported_ns = self._reported[name]
        if view.health == health:
            return
        if view.health == "stale" or now_ns - reported_ns >= REPORT_AGAIN_NS:
            what = "answers again" if view.health == "ok" else view.error
            message = f"{name} {view.health}: {what}"
            self._events.emit("device", message, device=name, health=view.health)
            self._reported[name] = view.health, now_ns


class DeviceThreads:
    """Polls slow devices until stopped, each in a thread: none waits for another."""

    def __init__(
        self,
        devices: Sequence[SlowDevice],
        clock_ns: Callable[[], int] = time.monotonic_ns,
        suspended_ns: Callable[[], int] = suspended_ns,
    ) -> None:
        self._devices = devices
        self._clock_ns = clock_ns
        self._suspended_ns = suspended_ns
        self._stop = threading.Event()
        self._threads: list[threading.Thread] = []

    def start(self) -> None:
        """Start the threads. Raises NoThreadError."""
        for device in self._devices:
            device.begin(self._clock_ns())
        for device in self._devices:
            poll = partial(self._poll, device)
            self._threads.append(start_thread(poll, f"motord-{device.name}"))

    def stop(self) -> None:
        """End the polling; every device gets a set-point of zero and is closed."""
        self._stop.set()
        for thread in self._threads:
            thread.join(JOIN_S)
        for device in self._devices:
            device.close()

    def _poll(self, device: SlowDevice) -> None:
        asleep_ns = self._suspended_ns()
        while not self._stop.wait(device.due_in_s(self._clock_ns())):
            before_ns, asleep_ns = asleep_ns, self._suspended_ns()
            if asleep_ns - before_ns > SUSPENDED_NS:  # the order looks as if it still held
                device.withhold(self._clock_ns())
            device.exchange(self._clock_ns)
