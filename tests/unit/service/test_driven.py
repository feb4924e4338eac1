"""Driven plans through the service: the drive is commanded, the power stage stays off."""

import numpy as np
import pytest

from motord.api.errors import RpcError
from motord.hal.base import DeviceReading
from motord.schema import State
from motord.service.bench.slow_devices import SlowDevice
from tests.unit.service.virtual_service import START_NS, VirtualService

SHORT = {"speeds_Hz": [0.8, 1.0], "turns": 2, "settle_s": 0.2}


def test_a_cogging_run_through_the_service() -> None:
    service = VirtualService()
    token = service.acquire()
    service.ask("plan/start", token=token, name="cogging", settings=SHORT, detach=False)
    captured = set()
    for _ in range(60):
        if not service.bench.plans.active:
            break
        service.run_s(1.0, token)
        if service.bench.plans.view.step.endswith("capturing"):
            captured.add(service.bench.state)
    view = service.bench.plans.view
    assert (view.state, view.points, view.points_done) == ("done", 2, 2)
    assert captured == {State.READY}
    assert [p["speed_mean_Hz"] for p in service.sink.points] == pytest.approx([0.8, 1.0], rel=0.01)
    assert all(p["driven"] and p["quality"] == "ok" for p in service.sink.points)
    assert service.bench.setpoint.drive_Hz == 0.0


def test_aborting_stops_the_drive() -> None:
    service = VirtualService()
    token = service.acquire()
    service.ask("plan/start", token=token, name="back-emf", settings=SHORT, detach=False)
    service.run_s(4.0, token)
    assert service.bench.setpoint.drive_Hz > 0.5
    service.ask("plan/abort", token=token)
    service.run_s(1.0, token)
    assert service.bench.plans.view.state == "aborted"
    assert service.bench.setpoint.drive_Hz == 0.0


def test_it_needs_a_drive_and_no_brake(monkeypatch: pytest.MonkeyPatch) -> None:
    service = VirtualService()
    token = service.acquire()
    monkeypatch.setattr(service.bench, "has", lambda name: name == "brake")
    with pytest.raises(RpcError, match="cogging needs a drive, and this bench has none"):
        service.ask("plan/start", token=token, name="cogging", settings=SHORT, detach=False)
    monkeypatch.setattr(service.bench, "has", lambda name: name == "drive")
    outline = service.ask(
        "plan/start", token=token, name="cogging", settings=SHORT, detach=False, dry_run=True
    )
    assert np.all([p["torque_Nm"] == 0.0 for p in outline["points"]])


class Drive:
    """A drive on a wire that notes its commands."""

    def __init__(self) -> None:
        self.written: list[float | str] = []

    def open(self) -> None:
        pass

    def exchange(self, setpoint: float) -> DeviceReading:
        self.written.append(setpoint)
        return DeviceReading(0, setpoint, 0.0)

    def safe_stop(self) -> None:
        self.written.append("safe")

    def close(self) -> None:
        pass


class Driven:
    """A READY bench whose drive turns at 1 Hz; steps and exchanges are the test's to make."""

    def __init__(self) -> None:
        self.wire = Drive()
        self.drive = SlowDevice("drive", self.wire, 0.05, 60.0, setpoint_valid_s=0.1, watchdog=True)
        self.drive.open(START_NS)
        self.service = VirtualService({"drive": self.drive})
        self.token = self.service.ready()
        self.service.ask("set", token=self.token, drive_Hz=1.0)
        assert self.step_and_poll() == TURNING

    def step_and_poll(self) -> float | str | None:
        """Let supervisor and thread come round; return what the device is commanded then."""
        self.service.step()
        return self.poll()

    def poll(self) -> float | str | None:
        before = len(self.wire.written)
        self.drive.exchange(lambda: self.service.now_ns)
        return self.wire.written[-1] if len(self.wire.written) > before else None


TURNING = pytest.approx(2 * np.pi)


def test_the_drive_turns_while_supervisor_and_loop_live() -> None:
    driven = Driven()
    for _ in range(50):
        driven.service.ask("lease/renew", token=driven.token)
        assert driven.step_and_poll() == TURNING


def test_a_supervisor_that_hangs_lets_the_drive_go_safe_and_starve() -> None:
    driven = Driven()
    driven.service.now_ns += 99_000_000
    assert driven.poll() == TURNING
    driven.service.now_ns += 1_000_000
    assert driven.poll() == "safe"
    for _ in range(10):
        driven.service.now_ns += 50_000_000
        assert driven.poll() is None


@pytest.mark.parametrize("clock", ["now_ns", "suspended_ns"])
def test_a_supervisor_that_was_away_does_not_go_on(clock: str) -> None:
    """Nor after the computer was suspended, which no monotonic clock shows."""
    driven = Driven()
    setattr(driven.service, clock, getattr(driven.service, clock) + 510_000_000)
    assert driven.step_and_poll() == 0.0
    said = "fault: the supervisor did not run for 0.5 s, and the drive was stopped"
    assert said in driven.service.messages()


def test_without_fresh_ticks_the_drive_goes_safe_and_starves() -> None:
    driven = Driven()
    driven.service.loop.running = False
    commands = [driven.step_and_poll() for _ in range(90)]
    assert commands[:10] == [TURNING] * 10
    assert commands[10:] == ["safe", *[None] * 79]
    driven.service.ask("lease/renew", token=driven.token)
    for _ in range(20):
        driven.step_and_poll()
    assert driven.service.bench.setpoint.drive_Hz == 0.0
    driven.service.loop.running = True
    assert driven.step_and_poll() == 0.0


@pytest.mark.parametrize("how", ["trip", "stop", "release", "expire", "loop"])
def test_what_takes_the_bench_away_takes_the_drive_to_zero(how: str) -> None:
    driven = Driven()
    service = driven.service
    if how == "trip":
        service.loop.virtual._tables[0]["bus_V_min"] = 29.0
    elif how == "stop":
        service.ask("stop")
    elif how == "release":
        service.ask("lease/release", token=driven.token)
    elif how == "loop":
        service.bench.loop_down("the loop ended")
    else:
        lease_s = service.config.zenoh.lease_s
        for _ in range(int(lease_s * 100)):
            driven.step_and_poll()
    for _ in range(3):
        command = driven.step_and_poll()
    assert command == 0.0
    assert service.bench.setpoint.drive_Hz == 0.0
