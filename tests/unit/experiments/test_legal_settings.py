"""A plan that its checks let pass does not trip the bench; all of it in the campaign."""

import pytest

from motord.experiments.torque_speed import plan as torque_speed
from tests.campaigns.legal_settings import DRAWS, drawn, outcome

SEEDS = range(4)


@pytest.mark.parametrize("name", [*DRAWS, "quick"])
def test_legal_settings_do_not_trip(name: str) -> None:
    outcomes = [outcome(*drawn(name, seed), seed) for seed in SEEDS]
    assert [why for kind, why in outcomes if kind == "TRIPPED"] == []
    assert any(kind in ("ran", "failed") for kind, _ in outcomes)  # not all are refused


@pytest.mark.parametrize("name", ["inertia-acceleration", "friction"])
def test_a_free_rotor_that_nobody_watches_trips(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    place = {"inertia-acceleration": "inertia.plan.acceleration", "friction": "friction.plan"}[name]
    monkeypatch.setattr(
        f"motord.experiments.{place}.runaway", lambda limits, torque_Nm: lambda seen: ""
    )
    torque = {"torque_Nm": 4.0, "repeats": 1}
    assert outcome(name, torque, 1)[0] == "TRIPPED"
    monkeypatch.undo()
    kind, why = outcome(name, torque, 1)
    assert kind == "failed"
    assert "lower torque_Nm: about 1." in why


SLIPPING = {"torques_Nm": [4.0], "speeds_Hz": [-1.68], "drive_torque_Nm": 5.0, "turns": 2}


def test_a_belt_that_slips_under_the_torque_ends_the_plan_not_the_bench(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kind, why = outcome("torque-speed", SLIPPING, 1)
    assert kind == "failed"
    assert "does the belt slip at this torque (drive_torque_Nm)?" in why
    monkeypatch.setattr(torque_speed, "_overpowered", lambda seen: "")
    assert outcome("torque-speed", SLIPPING, 1)[0] == "TRIPPED"


def test_the_brake_lets_go_once_the_torque_is_down() -> None:
    after_motoring = SLIPPING | {"torques_Nm": [5.0, 1.0], "speeds_Hz": [1.25, -1.0]}
    assert outcome("torque-speed", after_motoring | {"drive_torque_Nm": 1.2}, 1) == ("ran", "")


def test_a_rotor_that_the_brake_holds_back_is_aligned_with_any_current() -> None:
    """Its torque is nobody's set-point, and looked like a fault."""
    assert outcome("align", {"currents_A": [20.96], "brake": 0.95}, 1) == ("ran", "")
