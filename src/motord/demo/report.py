"""The demo's page: ripple before and after, estimates beside the truth."""

import numpy as np

from motord.demo.judge import CELLS, Verdict
from motord.demo.run import Demo
from motord.identify.result import CalibrationResult
from motord.identify.ripple import harmonics_table, spectrum
from motord.report.calibration import CalibrationReport, Estimate, View, write
from motord.report.plots.torque import Ripple
from motord.rig.truth import RigTruth

HIGHEST_ORDER = 300


def write_report(demo: Demo) -> None:
    """Write the page of a demo. Raises OSError."""
    write(demo.files.report, _contents(demo))


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
            _estimate("joint estimator", demo.joint),
            _estimate("residual estimator (2008 report)", demo.residual),
        ),
        reference=_truth(demo.truth, motor.counts),
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


def _estimate(label: str, result: CalibrationResult) -> Estimate:
    return Estimate(
        label=label,
        alpha=result.alpha,
        beta_A=result.beta_A,
        tau_cog_Nm=result.tau_cog_Nm,
        order=np.array([h.order for h in result.harmonics]),
        amplitude_Nm=np.array([h.amplitude_Nm for h in result.harmonics]),
        alpha_stderr=result.alpha_stderr,
        beta_stderr_A=result.beta_stderr_A,
        amplitude_stderr_Nm=np.array([h.stderr_Nm for h in result.harmonics]),
    )


def _truth(truth: RigTruth, counts: int) -> Estimate:
    order = np.array([h.order for h in truth.motor.cogging])
    amplitude_Nm = np.array([h.amplitude_Nm for h in truth.motor.cogging])
    phase_rad = np.array([h.phase_rad for h in truth.motor.cogging])
    return Estimate(
        label="truth",
        alpha=np.array(truth.inverter.alpha),
        beta_A=np.array(truth.inverter.beta_A),
        tau_cog_Nm=harmonics_table(order, amplitude_Nm, phase_rad, counts),
        order=order,
        amplitude_Nm=amplitude_Nm,
    )
