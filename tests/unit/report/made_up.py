"""A report's content made up for tests."""

import numpy as np

from motord.experiments.calibration.report import CalibrationReport, Estimate, View
from motord.report.plots.torque import Ripple

POINTS = [(torque, speed) for torque in (1.0, 3.0, 5.0) for speed in (0.5, 1.0)]


def ripple(size: float) -> Ripple:
    angle_rad = np.linspace(0, 2 * np.pi, 513)
    order = np.arange(1, 101)
    amplitude_Nm = np.full(100, 1e-4)
    amplitude_Nm[[15, 47]] = 0.3 * size
    return Ripple(angle_rad, size * np.sin(16 * angle_rad), order, amplitude_Nm, np.full(100, 1e-4))


def estimate(label: str, shift: float, stderr: float | None = 0.001) -> Estimate:
    angle_rad = 2 * np.pi * np.arange(256) / 256
    three = None if stderr is None else np.full(3, stderr)
    return Estimate(
        label=label,
        alpha=np.array([0.8, 1.118, 1.118]) * (1 + shift),
        beta_A=np.array([1.0, -0.5, -0.5]) + shift,
        tau_cog_Nm=0.1 * np.sin(16 * angle_rad),
        order=np.array([16, 48]),
        amplitude_Nm=np.array([0.1, 0.02]),
        alpha_stderr=three,
        beta_stderr_A=three,
        amplitude_stderr_Nm=None if stderr is None else np.full(2, stderr),
    )


def content(**changes: object) -> CalibrationReport:
    values: dict[str, object] = {
        "title": "Calibration <of> a motor & more",
        "lead": "axial-flux on bench sim",
        "facts": (("bench", "sim"), ("motor", "48 slots")),
        "torque_meaning": "true torque",
        "before": {point: 5.0 + point[0] / 2 for point in POINTS},
        "after": {point: 0.05 * point[0] for point in POINTS},
        "view": View("3 Nm, 0.5 turns/s", ripple(1.0), ripple(0.01), (8, 16, 24, 48, 96)),
        "estimates": (estimate("joint", 0.001), estimate("residual", 0.03)),
        "reference": estimate("truth", 0.0, None),
        "observable": ("common gain: assumed",),
    }
    return CalibrationReport(**{**values, **changes})  # type: ignore[arg-type]
