"""Slow devices: health, polling thread, zero set-point at the end."""

import random
import threading
import time

import pytest

from motord.hal.base import DeviceError, DeviceReading
from motord.service.bench.slow_devices import (
    SUSPENDED_NS,
    DeviceHealth,
    DeviceThreads,
    Order,
    SlowDevice,
)
from motord.service.host.events import EventLog
from tests.support.patience import PATIENCE_S

MS = 1_000_000


class Wire:
    """A device that answers, or not."""

    def __init__(self):
        self.answers = True
        self.exchanges = []
        self.seen, self.safe = threading.Event(), threading.Event()
        self.closed = self.stopped = False

    def open(self):
        if not self.answers:
            raise DeviceError("nothing there")

    def exchange(self, setpoint):
        self.exchanges.append(setpoint)
        if len(self.exchanges) >= 3:
            self.seen.set()
        if not self.answers:
            raise DeviceError("no answer")
        return DeviceReading(5, setpoint, 21.5)

    def safe_stop(self):
        self.stopped = True
        self.exchanges.append("safe")
        self.safe.set()

    def close(self):
        self.closed = True


def slow(wire, poll_s=0.05):
    return SlowDevice(
        "brake", wire, poll_s, stale_after_s=1.0, setpoint_valid_s=60.0, watchdog=True
    )


def test_health_goes_from_ok_to_failing_to_stale_and_back():
    wire, now = Wire(), [0]
    device = slow(wire)
    device.open(0)
    assert device.view(0).health == "ok"
    device.order(0.4, 0)
    device.exchange(lambda: now[0])
    view = device.view(0)
    assert (view.health, view.status, view.setpoint, view.value) == ("ok", 5, 0.4, 21.5)
    wire.answers = False
    device.exchange(lambda: 500_000_000)
    assert (device.view(500_000_000).health, device.view(0).error) == ("failing", "no answer")
    assert device.view(1_000_000_000).health == "failing"
    assert device.view(1_000_000_001).health == "stale"
    assert device.view(1_000_000_001).value == 21.5
    wire.answers = True
    device.exchange(lambda: 2_000_000_000)
    assert device.view(1_999_000_000).age_s == 0.0  # its thread goes on while the view is made
    assert device.view(2_000_000_000).health == "ok"


def test_why_there_is_no_power_stays_the_same_while_a_device_is_silent():
    """It is in the state, which is published and recorded when it changes."""
    device = slow(Wire())
    device.begin(0)
    device.order(0.0, 30_000_000_000)
    health = DeviceHealth({"brake": device}, 150.0, EventLog(lambda: 0))
    faults = {health.look(round(s * 1e9), drive_turns=False)[0] for s in (1.01, 1.02, 77.0)}
    assert faults == {"brake has not answered for 1 s: its driver does not return"}


def test_a_device_that_never_answered_goes_stale_too():
    wire = Wire()
    device = slow(wire)
    device.open(0)
    device.order(0.0, 0)
    wire.answers = False
    device.exchange(lambda: 0)
    assert device.view(10).health == "failing"
    assert device.view(2_000_000_000).health == "stale"
    assert device.view(0).value is None


def test_a_device_that_is_not_there_is_reported_at_once():
    wire = Wire()
    wire.answers = False
    with pytest.raises(DeviceError, match="nothing there"):
        slow(wire).open(0)


def test_polls_are_apart_by_poll_s_and_late_ones_are_not_made_up_for():
    device = slow(Wire())
    device.open(0)
    assert device.due_in_s(0) == 0.0
    device.exchange(lambda: 0)
    assert device.due_in_s(0) == pytest.approx(0.05)
    device.exchange(lambda: 1_000_000_000)
    assert device.due_in_s(1_000_000_000) == 0.0
    device.exchange(lambda: 1_000_000_001)
    assert device.due_in_s(1_000_000_001) == pytest.approx(0.05)


def test_the_thread_polls_every_device_and_leaves_them_at_zero():
    wires = [Wire(), Wire()]
    devices = [slow(wire, poll_s=0.002) for wire in wires]
    for device in devices:
        device.open(0)
        device.order(0.25, time.monotonic_ns())
    thread = DeviceThreads(devices)
    thread.start()
    assert all(wire.seen.wait(10.0) for wire in wires)
    thread.stop()
    polled = [len(wire.exchanges) for wire in wires]
    assert all(wire.stopped and wire.closed for wire in wires)
    assert [wire.exchanges[-2:] for wire in wires] == [[0.25, "safe"]] * 2
    assert [len(wire.exchanges) for wire in wires] == polled


def test_an_order_of_before_the_computer_was_suspended_is_not_written_after_it():
    """Its time by the monotonic clock is not over, and the supervisor may step later."""
    wire, suspended_ns = Wire(), [5 * SUSPENDED_NS]
    device = slow(wire, poll_s=0.002)
    device.open(0)
    device.order(0.25, time.monotonic_ns())
    threads = DeviceThreads([device], suspended_ns=lambda: suspended_ns[0])
    threads.start()
    assert wire.seen.wait(PATIENCE_S)
    suspended_ns[0] += SUSPENDED_NS + 1
    assert wire.safe.wait(PATIENCE_S)
    threads.stop()
    assert set(wire.exchanges[: wire.exchanges.index("safe")]) == {0.25}
    assert set(wire.exchanges[wire.exchanges.index("safe") :]) == {"safe"}


def test_without_devices_there_is_no_thread():
    before = threading.active_count()
    thread = DeviceThreads([])
    thread.start()
    assert threading.active_count() == before
    thread.stop()


def test_an_order_is_worth_nothing_once_its_time_is_over():
    order = Order(5.0, 100)
    assert [order.at(now_ns) for now_ns in (0, 99, 100, 101)] == [5.0, 5.0, None, None]


@pytest.mark.parametrize("hold_ms", [0, 700])
def test_without_orders_a_device_is_made_safe_once_and_written_no_more(hold_ms):
    wire = Wire()
    device = SlowDevice(
        "drive", wire, 0.05, 1.0, setpoint_valid_s=0.1, hold_s=hold_ms * 1e-3, watchdog=True
    )
    device.open(0)
    written_ms = []
    for ms in range(0, 3000, 50):
        if ms <= 500 or ms >= 2500:
            device.order(7.0, ms * MS)
        before = len(wire.exchanges)
        device.exchange(lambda ms=ms: ms * MS)
        written_ms += [(ms, what) for what in wire.exchanges[before:]]
        assert (device.view(ms * MS).error != "") == (600 <= ms < 2500)
    safe_ms = 600 + hold_ms
    assert written_ms == [
        *((ms, 7.0) for ms in range(0, 600, 50)),
        (safe_ms, "safe"),
        *((ms, 7.0) for ms in range(2500, 3000, 50)),
    ]


@pytest.mark.parametrize("seed", range(20))
def test_no_set_point_is_written_later_than_its_order_allows(seed):
    """Whatever the supervisor and the thread do when: hang, come back, hold back."""
    draw, wire, now_ns, given_ns, value = random.Random(seed), Wire(), 0, None, 0.0
    device = SlowDevice("drive", wire, 0.05, 1.0, setpoint_valid_s=0.1, watchdog=True)
    for _ in range(500):
        now_ns += draw.choice([1, 20 * MS, 99 * MS, 100 * MS, 400 * MS])
        what = draw.choice(["order", "withhold", "exchange", "exchange", "exchange"])
        if what == "order":
            given_ns, value = now_ns, draw.uniform(-9.0, 9.0)
            device.order(value, now_ns)
        elif what == "withhold":
            given_ns = None
            device.withhold(now_ns)
        else:
            before = len(wire.exchanges)
            device.exchange(lambda now_ns=now_ns: now_ns)
            fresh = given_ns is not None and now_ns - given_ns < 100 * MS
            wrote = wire.exchanges[before:]
            assert wrote == [value] if fresh else wrote in ([], ["safe"])
            assert fresh or len(wire.exchanges) < 2 or wire.exchanges[-2:] != ["safe", "safe"]


def test_a_supervisor_that_still_starts_is_no_fault_of_a_device():
    """It opens devices, gives a first order, and takes a second or more for all else."""
    wire = Wire()
    device = SlowDevice("drive", wire, 0.05, 1.0, setpoint_valid_s=0.1, watchdog=True)
    device.open(0)
    device.order(0.0, 0)
    device.begin(2000 * MS)
    device.exchange(lambda: 2000 * MS)
    assert wire.exchanges == ["safe"]
    view = device.view(2001 * MS)
    assert (view.health, view.error) == ("ok", "")
    stale = device.view(3001 * MS)
    assert (stale.health, "no order" in stale.error) == ("stale", True)


def test_the_time_before_the_polling_is_no_silence():
    wire = Wire()
    device = SlowDevice("drive", wire, 0.05, 1.0, setpoint_valid_s=0.1, watchdog=True)
    device.open(0)
    threads = DeviceThreads([device], lambda: 2000 * MS)
    threads.start()
    view = device.view(2000 * MS)
    assert (view.health, view.error, view.age_s) == ("ok", "", 0.0)
    threads.stop()


def ordered_once(setpoint, *, watchdog):
    """Return a device that took one order, at 0, and its wire, which does not answer any more."""
    wire = Wire()
    device = SlowDevice("slow", wire, 0.05, 1.0, setpoint_valid_s=0.1, watchdog=watchdog)
    device.order(setpoint, 0)
    device.exchange(lambda: 0)
    wire.answers = False
    return device, wire


def test_a_device_without_a_watchdog_is_made_safe_until_it_answers():
    """One that is away when its order expires would stay as it is."""
    device, wire = ordered_once(0.8, watchdog=False)
    for ms in range(100, 600, 50):
        device.exchange(lambda ms=ms: ms * MS)
        assert device.view(ms * MS).error == "no answer"
    wire.answers = True
    for ms in range(600, 2000, 50):
        device.exchange(lambda ms=ms: ms * MS)
        assert "no order" in device.view(ms * MS).error
    assert wire.exchanges == [0.8, *["safe", 0.0] * 11]  # ten in vain
    assert device.view(2000 * MS).setpoint == 0.0


def test_a_drive_that_refuses_is_left_to_its_watchdog():
    """A refused request may feed it, too."""
    device, wire = ordered_once(7.0, watchdog=True)
    for ms in range(100, 2000, 50):
        device.exchange(lambda ms=ms: ms * MS)
    assert wire.exchanges == [7.0, "safe"]


def test_a_driver_that_does_not_return_is_why_a_device_is_stale():
    device = SlowDevice("brake", Wire(), 0.05, 1.0, setpoint_valid_s=0.1, watchdog=False)
    device.open(0)
    device.order(0.8, 1200 * MS)
    view = device.view(1200 * MS)
    assert (view.health, view.error) == ("stale", "its driver does not return")


def test_a_driver_that_errs_in_its_safe_stop_does_not_end_the_thread():
    class Errs(Wire):
        def safe_stop(self):
            raise ZeroDivisionError("of a bug")

    device = SlowDevice("drive", Errs(), 0.05, 1.0, setpoint_valid_s=0.1, watchdog=True)
    device.exchange(lambda: 0)
    assert "ZeroDivisionError" in device.view(0).error


def test_a_device_that_is_silent_keeps_no_other_waiting():
    held, wires = threading.Event(), [Wire(), Wire()]
    wires[0].exchange = lambda setpoint: held.wait(60.0)
    devices = [slow(wire, poll_s=0.002) for wire in wires]
    for device in devices:
        device.open(0)
        device.order(0.25, time.monotonic_ns())
    threads = DeviceThreads(devices)
    threads.start()
    assert wires[1].seen.wait(10.0)
    held.set()
    threads.stop()
