"""A plan that its checks let pass does not trip the bench; all of it in the campaign."""

import pytest

from tests.campaigns.legal_settings import DRAWS, drawn, outcome

SEEDS = range(4)
TRIPS_TODAY = {
    "align": "a current vector of more than 15 A at a held rotor shows as torque that nobody asked",
    "torque-speed": "the belt slips at the drive_torque_Nm that was set",
}
"""Plans that may trip at legal settings, and by what."""


@pytest.mark.parametrize("name", [name for name in [*DRAWS, "quick"] if name not in TRIPS_TODAY])
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
