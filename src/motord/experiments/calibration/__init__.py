"""Calibration: current gains alpha, current offsets beta and cogging torque from the mesh."""

from motord.config.experiments import experiment
from motord.config.figures import FigureKind
from motord.config.plans import CalibrateConfig

EXPERIMENT = experiment(
    __name__,
    "calibrate",
    settings=CalibrateConfig(),
    plan="torque/speed mesh without compensation, for alpha, beta and cogging",
    analysis="Identify gains, offsets and cogging torque; -o writes the calibration file.",
    schema="motord.calibration/1",
    position=20,
    figures=(
        FigureKind("alpha", summary="current gain of each phase", budget="alpha", by=("phase",)),
        FigureKind(
            "alpha_spread",
            summary="largest current gain less the smallest",
            value="alpha",
            budget="alpha",
            by=("phase",),
            combine="spread",
        ),
        FigureKind(
            "beta_A", summary="current offset of each phase", budget="beta_A", by=("phase",)
        ),
        FigureKind(
            "delta_epsilon",
            summary="common gain of torque and current sensors",
            budget="delta_epsilon",
        ),
        FigureKind(
            "cogging_Nm",
            summary="amplitude of each order of the cogging torque",
            value="amplitude_Nm",
            budget="cogging_Nm",
            rows="tau_cog_harmonics",
            by=("order",),
        ),
    ),
)
