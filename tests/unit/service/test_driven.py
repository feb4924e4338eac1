"""Driven plans through the service: the drive is told, the power stage stays off."""

import numpy as np
import pytest

from motord.schema import State
from motord.service.refusal import Refusal
from tests.unit.service.virtual_service import VirtualService

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
    with pytest.raises(Refusal, match="cogging needs a drive, and this bench has none"):
        service.ask("plan/start", token=token, name="cogging", settings=SHORT, detach=False)
    monkeypatch.setattr(service.bench, "has", lambda name: name == "drive")
    outline = service.ask(
        "plan/start", token=token, name="cogging", settings=SHORT, detach=False, dry_run=True
    )
    assert np.all([p["torque_Nm"] == 0.0 for p in outline["points"]])
