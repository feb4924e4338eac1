"""Passes of learning on a small mesh of the rig whose sensors are not linear, recorded."""

from pathlib import Path

import numpy as np

from motord.calibration import Calibration
from motord.config import Config, load, packaged
from motord.experiments.plans import build
from motord.recording.metadata import describe
from motord.recording.writer import RunWriter
from motord.virtual import VirtualBench
from motord.virtual.plan import run_plan

MESH = {"torques_Nm": [3.0], "speeds_Hz": [0.8, 1.0], "turns": 5, "settle_s": 1.0}


def nonlinear() -> Config:
    bench = load().bench.model_copy(update={"rig": packaged("nonlinear.rig.toml")})
    return load().model_copy(update={"bench": bench})


def record_pass(
    path: Path, calibration: Calibration, seed: int, plan: str = "learn", **mesh: object
) -> None:
    """Record a pass over the mesh with `calibration` in force."""
    config = nonlinear()
    metadata = describe(config, packaged("sim.toml").read_text(), calibration_id=calibration.id)
    bench = VirtualBench(config, seed=seed, calibration=calibration)
    with RunWriter(path, metadata) as writer:
        for point in run_plan(
            bench,
            build(plan, config, {**MESH, **mesh}),
            lambda ticks, truth: (writer.ticks(ticks), writer.truth(truth))[0],
        ):
            writer.operating_point(int(point["t_end_ns"]), point)


def true_calibration() -> Calibration:
    """Return a calibration that knows the rig but for its nonlinearity."""
    from datetime import UTC, datetime

    from motord.calibration import CalibratedMotor
    from motord.identification.harmonics import harmonics_table
    from motord.rig.truth import load as load_truth

    config, truth = nonlinear(), load_truth(packaged("nonlinear.rig.toml"))
    cogging = truth.motor.cogging
    table = harmonics_table(
        np.array([h.order for h in cogging]),
        np.array([h.amplitude_Nm for h in cogging]),
        np.array([h.phase_rad for h in cogging]),
        config.motor.counts,
    )
    return Calibration(
        created=datetime(2026, 1, 1, tzinfo=UTC),
        motor=CalibratedMotor.of(config.motor),
        method="joint",
        alpha=truth.inverter.alpha,
        alpha_stderr=(0.0, 0.0, 0.0),
        beta_A=truth.inverter.beta_A,
        beta_stderr_A=(0.0, 0.0, 0.0),
        tau_cog_Nm=tuple(table.tolist()),
        condition_number=1.0,
    )
