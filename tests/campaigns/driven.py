"""Driven rotors of the simulated rig, of several motors, for the campaigns and for unit tests."""

from dataclasses import dataclass
from math import lcm
from typing import Any

import numpy as np

from motord.config import BackEmfHarmonic, Config, load
from motord.experiments.plans import build
from motord.identification.operating_points import PointData
from motord.rig.truth import RigTruth, TorqueHarmonicTruth
from motord.rig.truth import load as load_truth
from motord.schema import TICK_DTYPE
from motord.virtual import VirtualBench
from motord.virtual.plan import run_plan


@dataclass(frozen=True)
class Motor:
    """A motor to simulate; None is the packaged one."""

    slots: int = 48
    poles: int = 16
    counts: int = 4096
    connection: str = "independent"

    @property
    def name(self) -> str:
        return f"{self.slots}/{self.poles}, {self.counts} counts, {self.connection}"


REPORT = Motor()
MOTORS = (
    Motor(12, 10, 1000, "star"),
    Motor(36, 12, 20_000, "independent"),
    Motor(18, 24, 2001, "star"),
    Motor(9, 8, 8192, "independent"),
)

SPEEDS_HZ = (0.73, 0.87, 1.13, 1.37)
"""Of those: at lower speeds the order of the poles meets the resonance of rotor and belt."""


def bench_of(motor: Motor) -> tuple[Config, RigTruth]:
    """Return config and truth of a motor: cogging at its main order, of its slots and poles."""
    config, truth = load(), load_truth()
    if motor == REPORT:
        return config, truth
    emf = (
        BackEmfHarmonic(order=1, amplitude_V_s_per_rad=0.206),
        BackEmfHarmonic(order=3, amplitude_V_s_per_rad=0.012, phase_rad=0.4),
        BackEmfHarmonic(order=5, amplitude_V_s_per_rad=0.006, phase_rad=-0.7),
    )
    main = lcm(motor.slots, motor.poles)
    amplitudes = {motor.poles: (0.06, 0.6), motor.slots: (0.05, -1.1)}
    amplitudes |= {main: (0.3, 0.3), 2 * main: (0.05, 1.4)}
    cogging = tuple(
        TorqueHarmonicTruth(order=order, amplitude_Nm=a, phase_rad=phase)
        for order, (a, phase) in sorted(amplitudes.items())
    )
    common = {"pole_pairs": motor.poles // 2, "connection": motor.connection, "back_emf": emf}
    configured = {**common, "name": motor.name, "slots": motor.slots, "counts": motor.counts}
    config = config.model_copy(update={"motor": config.motor.model_copy(update=configured)})
    truth = truth.model_copy(
        update={
            "motor": truth.motor.model_copy(update={**common, "cogging": cogging}),
            "encoder": truth.encoder.model_copy(update={"counts": motor.counts}),
        }
    )
    return config, truth


def ticks_of(
    name: str, motor: Motor, seed: int, rate_Hz: int | None = None, **settings: Any
) -> tuple[Config, RigTruth, list[PointData]]:
    """Run plan `name` in virtual time; return config, truth and the captured points."""
    config, truth = bench_of(motor)
    if rate_Hz:
        config = config.model_copy(
            update={"loop": config.loop.model_copy(update={"rate_Hz": rate_Hz})}
        )
    if motor != REPORT:
        settings.setdefault("speeds_Hz", SPEEDS_HZ)
    bench = VirtualBench(config, truth=truth, seed=seed)
    blocks: list[np.ndarray] = []
    plan = build(name, config, settings)
    points = run_plan(bench, plan, lambda ticks, _: blocks.append(ticks[ticks["plan_point"] >= 0]))
    ticks = np.concatenate([np.zeros(0, TICK_DTYPE), *blocks])
    return (
        config,
        truth,
        [
            PointData(0.0, float(p["speed_Hz"]), ticks[ticks["plan_point"] == p["index"]])
            for p in points
        ],
    )


def inverter_apart(point: PointData, every: int, seed: int) -> PointData:
    """Return every so many ticks, with voltages of a tick before them and their age stated."""
    ticks = point.ticks
    rows = np.arange(every, ticks.size, every)
    older = np.random.default_rng(seed).integers(0, every, rows.size)
    taken = ticks[rows].copy()
    for phase in "abc":
        taken[f"u_{phase}_V"] = ticks[f"u_{phase}_V"][rows - older]
    taken["i_age_ns"] = ticks["t_ns"][rows] - ticks["t_ns"][rows - older]
    return PointData(point.torque_Nm, point.speed_Hz, taken)
