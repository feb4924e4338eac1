"""A page of a calibration made up for tests."""

import numpy as np

from motord.calibration import Harmonic, RmsErrors, RmsPoint, TorqueSpeed
from motord.experiments.calibration import report as calibration
from motord.experiments.calibration.estimate.result import Estimate
from motord.experiments.calibration.report import Labelled
from motord.experiments.ripple import report as ripple
from motord.report.html import Page
from motord.report.plots.torque import TorqueCurve

POINTS = [(torque, speed) for torque in (1.0, 3.0, 5.0) for speed in (0.5, 1.0)]
BEFORE = {point: 5.0 + point[0] / 2 for point in POINTS}
AFTER = {point: 0.05 * point[0] for point in POINTS}


def curve(size: float) -> TorqueCurve:
    angle_rad = np.linspace(0, 2 * np.pi, 513)
    order = np.arange(1, 101)
    amplitude_Nm = np.full(100, 1e-4)
    amplitude_Nm[[15, 47]] = 0.3 * size
    torque_Nm = size * np.sin(16 * angle_rad)
    return TorqueCurve(angle_rad, torque_Nm, order, amplitude_Nm, np.full(100, 1e-4))


def estimate(
    shift: float,
    stderr: float | None = 0.001,
    amplitudes_Nm: dict[int, float] | None = None,
) -> Estimate:
    angle_rad = 2 * np.pi * np.arange(256) / 256
    three = None if stderr is None else np.full(3, stderr)
    return Estimate(
        alpha=np.array([0.8, 1.118, 1.118]) * (1 + shift),
        beta_A=np.array([1.0, -0.5, -0.5]) + shift,
        tau_cog_Nm=0.1 * np.sin(16 * angle_rad),
        harmonics=tuple(
            Harmonic(order=order, amplitude_Nm=size_Nm, phase_rad=0.0, stderr_Nm=stderr or 0.0)
            for order, size_Nm in (amplitudes_Nm or {16: 0.1, 48: 0.02}).items()
        ),
        alpha_stderr=three,
        beta_stderr_A=three,
    )


BOTH = (("joint", estimate(0.001)), ("residual", estimate(0.03)))
TRUTH = ("truth", estimate(0.0, None))


def page(
    *,
    before: dict[TorqueSpeed, float] = BEFORE,
    after: dict[TorqueSpeed, float] = AFTER,
    curves: tuple[TorqueCurve | None, TorqueCurve | None] | None = (curve(1.0), curve(0.01)),
    estimates: tuple[Labelled, ...] = BOTH,
    reference: Labelled | None = TRUTH,
) -> Page:
    """Return a page of the parts that pages of calibrations and verifications are made of."""
    made = Page("Calibration <of> a motor & more", "axial-flux on bench sim")
    places = sorted(before.keys() | after.keys())
    points = (
        RmsPoint(torque_Nm=t, speed_Hz=s, before=before.get((t, s)), after=after.get((t, s)))
        for t, s in places
    )
    ripple.fill_key_figures(made, RmsErrors.of(tuple(points)))
    ripple.fill_mesh(made, before, after, "true torque")
    if curves is not None:
        ripple.fill_torque(made, "3 Nm, 0.5 turns/s", *curves, (8, 16, 24, 48, 96))
    if estimates:
        calibration.fill(made, estimates, reference)
    return made
