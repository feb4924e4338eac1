"""The demo's page: ripple of the true torque before and after, estimates beside the truth."""

import numpy as np

from motord.experiments.calibration import report as calibration
from motord.experiments.ripple import report as ripple
from motord.report.html import Page
from motord.report.plots.torque import TorqueCurve
from motord.reproduce.bench import true_estimate
from motord.reproduce.demo import RUNS, Demo
from motord.reproduce.evaluate import CELLS, Ripple

HIGHEST_ORDER = 300

LEAD = (
    "A simulated bench was taken over a mesh of torques and speeds, calibrated from its "
    "own torque sensor, and taken over the mesh again with compensation. The errors "
    "shown are those of the true torque, which the controller never sees."
)


def write_report(demo: Demo) -> None:
    """Write the page of a demo. Raises OSError."""
    before, after = demo.before, demo.after
    page = Page("motord demo: torque ripple before and after calibration", LEAD)
    ripple.fill_key_figures(page, before.true_percent, after.true_percent)
    ripple.fill_mesh(page, before.true_percent, after.true_percent, "true torque")
    torque_Nm, speed_Hz = before.shown
    pole_pairs = demo.config.motor.pole_pairs
    orders = range(pole_pairs, HIGHEST_ORDER, pole_pairs)
    label = f"{torque_Nm:g} Nm, {speed_Hz:g} Hz"
    ripple.fill_torque(page, label, _curve(before), _curve(after), orders)
    estimates = (
        ("joint estimator", demo.calibrated.joint),
        ("residual estimator (2008 report)", demo.calibrated.residual),
    )
    truth = true_estimate(demo.truth, demo.config.motor.counts)
    calibration.fill(page, estimates, ("truth", truth))
    page.heading("About these figures")
    page.points(demo.calibration.observable)
    page.table((), _facts(demo))
    page.write(demo.files["report"])


def _facts(demo: Demo) -> tuple[tuple[str, str], ...]:
    motor, summary = demo.config.motor, demo.summary
    return (
        ("motor", f"{motor.name}, {motor.slots} slots, {2 * motor.pole_pairs} poles"),
        ("encoder", f"{motor.counts} counts a turn"),
        ("loop", f"{demo.config.loop.rate_Hz} Hz"),
        ("calibration", demo.calibration.id),
        ("bench time", f"{summary['bench_s']:.0f} s, computed in {summary['wall_s']:.0f} s"),
        ("recordings", ", ".join(RUNS)),
    )


def _curve(found: Ripple) -> TorqueCurve:
    return TorqueCurve(
        angle_rad=2 * np.pi * (np.arange(CELLS) + 0.5) / CELLS,
        torque_Nm=found.turn_Nm,
        order=np.arange(1, HIGHEST_ORDER + 1),
        amplitude_Nm=np.abs(np.fft.rfft(found.turn_Nm)[1 : HIGHEST_ORDER + 1] * 2 / CELLS),
    )
