"""Slow devices: health, polling thread, zero set-point at the end."""

import threading

import pytest

from motord.hal.base import DeviceError, DeviceReading
from motord.service.devices import DeviceThread, SlowDevice


class Wire:
    """A device that answers, or not."""

    def __init__(self):
        self.answers = True
        self.exchanges = []
        self.seen = threading.Event()
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

    def close(self):
        self.closed = True


def slow(wire, poll_s=0.05):
    return SlowDevice("brake", wire, poll_s, stale_after_s=1.0)


def test_health_goes_from_ok_to_failing_to_stale_and_back():
    wire, now = Wire(), [0]
    device = slow(wire)
    device.open(0)
    assert device.view(0).health == "ok"
    device.wanted = 0.4
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
    assert device.view(2_000_000_000).health == "ok"


def test_a_device_that_never_answered_goes_stale_too():
    wire = Wire()
    device = slow(wire)
    device.open(0)
    wire.answers = False
    device.exchange(lambda: 0)
    assert device.view(10).health == "failing"
    assert device.view(2_000_000_000).health == "stale"
    assert device.view(0).value is None


def test_a_device_that_is_not_there_is_told_at_once():
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
        device.wanted = 0.25
    thread = DeviceThread(devices)
    thread.start()
    assert all(wire.seen.wait(10.0) for wire in wires)
    thread.stop()
    polled = [len(wire.exchanges) for wire in wires]
    assert all(wire.stopped and wire.closed for wire in wires)
    assert [wire.exchanges[-1] for wire in wires] == [0.25, 0.25]
    assert [len(wire.exchanges) for wire in wires] == polled


def test_without_devices_there_is_no_thread():
    before = threading.active_count()
    thread = DeviceThread([])
    thread.start()
    assert threading.active_count() == before
    thread.stop()
