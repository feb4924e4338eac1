"""What every plan is checked for, whatever it is."""

from typing import Any

import pytest

from motord.config import Config, load
from motord.experiments import plans
from motord.experiments.plans import build
from motord.sequencing import PlanError
from motord.virtual import PlanFailed, VirtualBench, run_plan

HELD = {"torques_Nm": [6.0], "speeds_Hz": [1.0], "turns": 20, "settle_s": 2.0, "compensate": "off"}
RMS_A = 13.7
"""Of a phase of the packaged motor at 6 Nm."""


def bench(i2t_current_A: float, i2t_time_s: float = 10.0) -> Config:
    content = load().model_dump()
    content["limits"] |= {"i2t_current_A": i2t_current_A, "i2t_time_s": i2t_time_s}
    return Config.model_validate(content)


@pytest.mark.parametrize(
    ("name", "settings"), [("verify", HELD), ("soak", {"inner": HELD, "plan": "verify"})]
)
def test_a_torque_that_trips_by_its_heat_is_refused(name: str, settings: dict[str, Any]) -> None:
    with pytest.raises(PlanError, match=r"6 Nm at 1 Hz .* 13\.7 A RMS .* i2t_current_A = 10, i2t_"):
        build(name, bench(10.0), settings)


@pytest.mark.kernel
def test_what_is_refused_would_have_tripped(monkeypatch: pytest.MonkeyPatch) -> None:
    config = bench(10.0)
    monkeypatch.setattr(plans, "_check_i2t", lambda config, plan: None)
    with pytest.raises(PlanFailed, match="tripped: I2T"):
        run_plan(VirtualBench(config, seed=1), build("verify", config, HELD), lambda a, b: None)


def test_heat_that_is_just_allowed_is_not_refused() -> None:
    heat_s = ((plans.SENSED_PART * RMS_A / 10.0) ** 2 - 1.0) * (2.0 + 20 / 1.0)
    build("verify", bench(10.0, 1.02 * heat_s), HELD)
    with pytest.raises(PlanError, match="I2T"):
        build("verify", bench(10.0, 0.98 * heat_s), HELD)


def test_pauses_cool() -> None:
    soak = {"plan": "verify", "inner": {**HELD, "turns": 10}, "repeats": 100}
    build("soak", bench(10.0), {**soak, "pause_s": 30.0})
    with pytest.raises(PlanError, match="I2T"):
        build("verify", bench(10.0), {**HELD, "turns": 10, "torques_Nm": [5.5, 5.7, 5.9, 6.0]})


def test_repetitions_that_wait_until_the_bench_is_cool_are_judged_one_by_one() -> None:
    soak = {"plan": "verify", "inner": {**HELD, "turns": 12}, "repeats": 100, "pause_s": 0.0}
    with pytest.raises(PlanError, match="I2T"):
        build("soak", bench(10.0), soak)
    build("soak", bench(10.0), {**soak, "cool_below_C": 40.0})
    with pytest.raises(PlanError, match="I2T"):
        build("soak", bench(10.0), {**soak, "inner": HELD, "cool_below_C": 40.0})
