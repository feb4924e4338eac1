"""The demo's page: ripple before and after, estimates beside the truth."""

import numpy as np

from motord.demo.judge import CELLS, Verdict
from motord.demo.run import Demo
from motord.experiments.calibration.content import estimate_of_result, estimate_of_truth
from motord.experiments.calibration.report import CalibrationReport, View, page
from motord.identification.ripple import spectrum
from motord.report.plots.torque import Ripple

HIGHEST_ORDER = 300


def write_report(demo: Demo) -> None:
    """Write the page of a demo. Raises OSError."""
    page(_contents(demo)).write(demo.files.report)


def _contents(demo: Demo) -> CalibrationReport:
    motor = demo.config.motor
    torque_Nm, speed_Hz = demo.before.shown
    pole_pairs = motor.pole_pairs
    return CalibrationReport(
        title="motord demo: torque ripple before and after calibration",
        lead=(
            "A simulated bench was taken over a mesh of torques and speeds, calibrated from its "
            "own torque sensor, and taken over the mesh again with compensation. The errors "
            "shown are those of the true torque, which the controller never sees."
        ),
        facts=_facts(demo),
        torque_meaning="true torque",
        before=demo.before.true_percent,
        after=demo.after.true_percent,
        view=View(
            label=f"{torque_Nm:g} Nm, {speed_Hz:g} Hz",
            before=_ripple(demo.before),
            after=_ripple(demo.after),
            marked_orders=tuple(range(pole_pairs, HIGHEST_ORDER, pole_pairs)),
        ),
        estimates=(
            estimate_of_result(demo.joint, "joint estimator"),
            estimate_of_result(demo.residual, "residual estimator (2008 report)"),
        ),
        reference=estimate_of_truth(
            demo.truth.inverter.alpha,
            demo.truth.inverter.beta_A,
            [(h.order, h.amplitude_Nm, h.phase_rad) for h in demo.truth.motor.cogging],
            motor.counts,
        ),
        observable=demo.joint.observable,
    )


def _facts(demo: Demo) -> tuple[tuple[str, str], ...]:
    motor, summary = demo.config.motor, demo.summary
    return (
        ("motor", f"{motor.name}, {motor.slots} slots, {2 * motor.pole_pairs} poles"),
        ("encoder", f"{motor.counts} counts a turn"),
        ("loop", f"{demo.config.loop.rate_Hz} Hz"),
        ("calibration", demo.calibration.id),
        ("bench time", f"{summary['bench_s']:.0f} s, computed in {summary['wall_s']:.0f} s"),
        ("recordings", ", ".join(path.name for path in demo.files.runs)),
    )


def _ripple(verdict: Verdict) -> Ripple:
    amplitude_Nm, _ = spectrum(verdict.turn_Nm, HIGHEST_ORDER)
    return Ripple(
        angle_rad=2 * np.pi * (np.arange(CELLS) + 0.5) / CELLS,
        torque_Nm=verdict.turn_Nm,
        order=np.arange(1, HIGHEST_ORDER + 1),
        amplitude_Nm=amplitude_Nm,
    )
