"""Nothing assumes one motor: the simulated bench with others, calibrated, against the truth."""

from dataclasses import dataclass
from math import lcm

import numpy as np
import pytest

from motord.config import BackEmfHarmonic, Config, load
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.plans import build
from motord.identification import orders
from motord.identification.operating_points import PointData, split
from motord.rig.truth import RigTruth, TorqueHarmonicTruth
from motord.rig.truth import load as load_truth
from motord.virtual import VirtualBench
from motord.virtual.plan import run_plan
from tests.support.virtual_calibration import calibrate

MESH = {"torques_Nm": [1.5, 4.0], "speeds_Hz": [0.7, 1.0], "turns": 6, "settle_s": 1.0}

SINE = ((1, 0.206, 0.0),)
SLIGHTLY_BENT = ((1, 0.206, 0.2), (3, 0.009, 0.1), (5, -0.004, 0.0), (7, 0.002, -0.2))
TRAPEZOID = ((1, 0.206, 0.0), (3, 0.045, 0.0), (5, 0.008, 0.0), (7, -0.004, 0.0))


@dataclass(frozen=True)
class Motor:
    """A motor that is nothing like the packaged one, and the rate of the loop that turns it.

    Trapezoidal currents of twelve pole pairs change within a period of a loop at 1 kHz, and within
    an encoder count: alpha is then known to 0.3 % only.
    """

    slots: int
    poles: int
    counts: int
    connection: str
    back_emf: tuple[tuple[int, float, float], ...]
    direction: int = 1
    rate_Hz: int = 1000

    def __str__(self) -> str:
        return f"{self.slots}/{self.poles}-{self.counts}-{self.connection}"

    @property
    def cogging(self) -> tuple[TorqueHarmonicTruth, ...]:
        """One dislocated slot and the main order with its double."""
        main = lcm(self.slots, self.poles)
        return (
            TorqueHarmonicTruth(order=self.poles, amplitude_Nm=0.06, phase_rad=0.6),
            TorqueHarmonicTruth(order=main, amplitude_Nm=0.2, phase_rad=-1.1),
            TorqueHarmonicTruth(order=2 * main, amplitude_Nm=0.03, phase_rad=2.0),
        )


MOTORS = (
    Motor(12, 10, 1000, "star", SLIGHTLY_BENT),
    Motor(36, 12, 2001, "independent", SINE),
    Motor(36, 12, 1237, "star", TRAPEZOID),
    Motor(18, 24, 4096, "independent", SLIGHTLY_BENT, direction=-1),
    Motor(18, 24, 10_000, "independent", TRAPEZOID, rate_Hz=4000),
    Motor(9, 8, 20_000, "star", SINE),
    Motor(9, 8, 4095, "independent", SLIGHTLY_BENT),
)


def bench(motor: Motor) -> tuple[Config, RigTruth]:
    """Return the packaged bench with another motor: what is configured, what is true."""
    configured, truth = load(), load_truth()
    back_emf = tuple(
        BackEmfHarmonic(order=h, amplitude_V_s_per_rad=a, phase_rad=p) for h, a, p in motor.back_emf
    )
    changes = {"pole_pairs": motor.poles // 2, "connection": motor.connection, "back_emf": back_emf}
    configured_motor = configured.motor.model_copy(
        update={
            **changes,
            "slots": motor.slots,
            "counts": motor.counts,
            "encoder_direction": motor.direction,
        }
    )
    encoder = truth.encoder.model_copy(
        update={"counts": motor.counts, "direction": motor.direction}
    )
    true_motor = truth.motor.model_copy(update={**changes, "cogging": motor.cogging})
    loop = configured.loop.model_copy(update={"rate_Hz": motor.rate_Hz})
    return (
        Config.model_validate(
            configured.model_copy(update={"motor": configured_motor, "loop": loop}).model_dump()
        ),
        RigTruth.model_validate(
            truth.model_copy(update={"motor": true_motor, "encoder": encoder}).model_dump()
        ),
    )


def recorded(config: Config, truth: RigTruth) -> list[PointData]:
    blocks: list[np.ndarray] = []
    plan = build("calibrate", config, MESH)
    points = run_plan(
        VirtualBench(config, truth, seed=3), plan, lambda ticks, _: blocks.append(ticks)
    )
    return list(split(np.concatenate(blocks), points))


@pytest.fixture(scope="module", params=MOTORS, ids=str)
def found(request: pytest.FixtureRequest) -> tuple[Motor, RigTruth, CalibrationResult]:
    motor: Motor = request.param
    config, truth = bench(motor)
    result = calibrate(recorded(config, truth), config.motor, config.torque_sensor)
    return motor, truth, result


def test_gains_and_offsets(found: tuple[Motor, RigTruth, CalibrationResult]) -> None:
    _, truth, result = found
    alpha = np.array(truth.inverter.alpha)
    if result.delta_epsilon_stderr is None:
        alpha = alpha / np.cbrt(alpha.prod())
    assert result.alpha == pytest.approx(alpha, rel=5e-3)
    beta_A = np.array(truth.inverter.beta_A)
    if not any("offset of the currents: measured" in text for text in result.observable):
        beta_A = beta_A - beta_A.mean()
    assert result.beta_A == pytest.approx(beta_A, abs=0.06)
    errors = np.concatenate(
        [
            (result.alpha - alpha) / result.alpha_stderr,
            (result.beta_A - beta_A) / result.beta_stderr_A,
        ]
    )
    assert np.abs(errors).max() < 5


def test_cogging(found: tuple[Motor, RigTruth, CalibrationResult]) -> None:
    motor, _, result = found
    by_order = {h.order: h for h in result.harmonics}
    for true in motor.cogging:
        h = by_order.pop(true.order)
        line = h.amplitude_Nm * np.exp(1j * h.phase_rad)
        error_Nm = abs(line - true.amplitude_Nm * np.exp(1j * true.phase_rad))
        assert error_Nm < max(5 * h.stderr_Nm, 0.02 * true.amplitude_Nm)
        assert error_Nm < 0.01
    assert all(h.amplitude_Nm < max(5 * h.stderr_Nm, 2e-3) for h in by_order.values())
    assert result.tau_cog_Nm.shape == (motor.counts,)


@pytest.mark.parametrize(
    ("slots", "poles", "main"), [(12, 10, 60), (36, 12, 36), (18, 24, 72), (9, 8, 72), (48, 16, 48)]
)
def test_the_main_order_is_of_slots_and_poles(slots: int, poles: int, main: int) -> None:
    assert orders.main_order(slots, poles) == main
    allowed = orders.allowed_orders(slots, poles, 10_000)
    assert {main, 2 * main, poles, slots} <= set(allowed)
    assert all(order % poles == 0 or order % slots == 0 for order in allowed)
