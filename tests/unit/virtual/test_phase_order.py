"""Encoders that count backwards from anywhere, and exchanged phases: right where configured."""

import numpy as np
import pytest

from motord.config import Config, load
from motord.control.types import SETPOINT
from motord.rig.truth import RigTruth
from motord.rig.truth import load as load_truth
from motord.schema import Request
from motord.virtual import VirtualBench
from motord.virtual.preflight import nominal_rig

CASES = [(0.7, 1, "abc"), (2.0, -1, "abc"), (0.0, 1, "acb"), (4.6, -1, "acb")]


def misaligned(offset_rad: float, direction: int, order: str) -> RigTruth:
    truth = load_truth().model_dump()
    truth["encoder"] |= {"offset_rad": offset_rad, "direction": direction}
    truth["inverter"] |= {
        "phase_order": order, "alpha": (1.0, 1.0, 1.0), "beta_A": (0.0, 0.0, 0.0),
    }  # fmt: skip
    return RigTruth.model_validate(truth)


def configured(offset_rad: float, direction: int, order: str) -> Config:
    config = load().model_dump()
    config["motor"] |= {
        "encoder_offset_rad": offset_rad, "encoder_direction": direction, "phase_order": order,
    }  # fmt: skip
    return Config.model_validate(config)


def torque_Nm(config: Config, truth: RigTruth) -> np.ndarray:
    """Return the true electromagnetic torque while 1.5 Nm are asked for."""
    bench = VirtualBench(config, truth, seed=3)
    setpoint = np.zeros(1, SETPOINT)
    bench.run(setpoint, 10)
    setpoint["request"], setpoint["request_seq"] = Request.ENABLE, 1
    setpoint["torque_Nm"], setpoint["brake"] = 1.5, 0.5
    bench.run(setpoint, 600)
    return bench.run(setpoint, 1000)[1]["torque_em_Nm"]


@pytest.mark.parametrize("case", CASES)
def test_the_right_configuration_makes_the_requested_torque(case: tuple) -> None:
    made_Nm = torque_Nm(configured(*case), misaligned(*case))
    assert np.abs(made_Nm - 1.5).max() < 0.05


@pytest.mark.parametrize("case", CASES)
def test_a_wrong_configuration_does_not(case: tuple) -> None:
    made_Nm = torque_Nm(load(), misaligned(*case))
    assert np.abs(made_Nm - 1.5).mean() > 0.3


@pytest.mark.parametrize("order", ["abc", "acb"])
def test_the_rig_of_a_bench_without_one_has_the_configured_phase_order(order: str) -> None:
    config = configured(0.3, -1, order)
    config = config.model_copy(update={"bench": config.bench.model_copy(update={"rig": None})})
    aligned, truth = nominal_rig(config)
    assert truth.inverter.phase_order == aligned.motor.phase_order == order
    assert np.abs(torque_Nm(aligned, truth) - 1.5).max() < 0.05
