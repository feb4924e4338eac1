"""A plan that its checks let pass does not trip the bench; all of it in the campaign."""

from types import ModuleType
from typing import Any

import pytest

from motord.experiments.free_rotor import FreeRotor
from motord.experiments.friction import plan as friction
from motord.experiments.inertia.plan import acceleration
from motord.experiments.torque_speed import plan as torque_speed
from motord.sequencing import motions
from tests.campaigns.legal_settings import DRAWS, bench, bench_changes, drawn, outcome

SEEDS = range(4)
CONFIG, TRUTH = bench({}, 0)

KINDS = [*DRAWS, "quick"]


@pytest.mark.parametrize("name", KINDS)
def test_legal_settings_do_not_trip(name: str) -> None:
    outcomes = [outcome(*drawn(name, seed, CONFIG), seed, CONFIG, TRUTH) for seed in SEEDS]
    assert [why for kind, why in outcomes if kind == "TRIPPED"] == []
    assert any(kind in ("ran", "failed") for kind, _ in outcomes)  # not all are refused


@pytest.mark.parametrize("name", KINDS)
def test_legal_benches_do_not_trip(name: str) -> None:
    outcomes = []
    for seed in SEEDS:
        config, truth = bench(bench_changes(seed), seed)
        outcomes.append(outcome(*drawn(name, seed, config), seed, config, truth))
    assert [why for kind, why in outcomes if kind == "TRIPPED"] == []
    assert any(kind in ("ran", "failed") for kind, _ in outcomes)  # not all are refused


def outcome_of(name: str, settings: dict[str, Any]) -> tuple[str, str]:
    """Run a plan on the packaged bench; see `outcome`."""
    return outcome(name, settings, 1, CONFIG, TRUTH)


def unwatched(monkeypatch: pytest.MonkeyPatch, plan: ModuleType) -> None:
    monkeypatch.setattr(plan, "runaway", lambda limits, torque_Nm: lambda seen: "")


def test_a_torque_rises_as_slowly_as_a_free_rotor_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    torque = {"torque_Nm": 4.0, "repeats": 2}
    assert outcome_of("inertia-acceleration", torque) == ("ran", "")
    monkeypatch.setattr(FreeRotor, "rise_s", lambda rotor, limits, torque_Nm, to_speed_Hz: 0.0)
    kind, why = outcome_of("inertia-acceleration", torque)
    assert kind == "failed"
    assert "above 0.9 of [limits] trip_speed_rad_s = " in why
    assert "lower torque_Nm (about 1." in why
    unwatched(monkeypatch, acceleration)
    assert outcome_of("inertia-acceleration", torque)[0] == "TRIPPED"


@pytest.mark.parametrize("timeout_s", [1.0, 3.0])
def test_a_slow_rise_takes_none_of_the_time_to_reach_the_speed(timeout_s: float) -> None:
    settings = {"torque_Nm": 4.0, "repeats": 2, "rest_s": 0.5, "timeout_s": timeout_s}
    assert outcome_of("inertia-acceleration", settings) == ("ran", "")


def test_a_strong_brake_does_not_look_like_an_encoder_that_jumps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It stops a light rotor within some ticks."""
    strong = {"torque_max_Nm": 100.0, "critical_speed_rad_s": 25.0, "excitation_time_constant_s": 0}
    limits = {"trip_speed_rad_s": 40.0, "encoder_jump_rad": 0.05}
    bench_file = {"brake": strong, "limits": limits}
    config, truth = bench(bench_file, 0)
    settings = {"torque_Nm": 2.0, "stop_speed_Hz": 1.5, "repeats": 2}
    found = outcome("inertia-acceleration", settings, 1, config, truth)
    assert found == ("ran", "")
    monkeypatch.setattr(motions, "BRAKE_RISE_S", 1e-6)
    assert outcome("inertia-acceleration", settings, 1, config, truth)[0] == "TRIPPED"


@pytest.mark.parametrize("torque_Nm", [2.0, 4.0, 6.0])
def test_a_torque_that_rises_slowly_brings_a_free_rotor_to_any_speed(
    torque_Nm: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    torque = {"torque_Nm": torque_Nm, "repeats": 1}
    assert outcome_of("friction", torque) == ("ran", "")
    monkeypatch.setattr(friction, "SLOW_RISE_S", 0.01)
    assert outcome_of("friction", torque)[0] != "ran"
    unwatched(monkeypatch, friction)
    assert outcome_of("friction", torque)[0] == "TRIPPED"


SLIPPING = {"torques_Nm": [4.0], "speeds_Hz": [-1.68], "drive_torque_Nm": 5.0, "turns": 2}


def test_a_belt_that_slips_under_the_torque_ends_the_plan_not_the_bench(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kind, why = outcome_of("torque-speed", SLIPPING)
    assert kind == "failed"
    assert "does the belt slip at this torque (drive_torque_Nm)?" in why
    monkeypatch.setattr(torque_speed, "_overpowered", lambda seen: "")
    assert outcome_of("torque-speed", SLIPPING)[0] == "TRIPPED"


def test_the_brake_lets_go_once_the_torque_is_down() -> None:
    after_motoring = SLIPPING | {"torques_Nm": [5.0, 1.0], "speeds_Hz": [1.25, -1.0]}
    assert outcome_of("torque-speed", after_motoring | {"drive_torque_Nm": 1.2}) == ("ran", "")


def test_a_rotor_that_the_brake_holds_back_is_aligned_with_any_current() -> None:
    """Its torque is nobody's set-point, and looked like a fault."""
    assert outcome_of("align", {"currents_A": [20.96], "brake": 0.95}) == ("ran", "")
