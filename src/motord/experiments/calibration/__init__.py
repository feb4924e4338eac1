"""Calibration: current gains alpha, current offsets beta and cogging torque from the mesh."""

from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.figures import FigureKind
from motord.config.plans import CalibrateConfig

EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            "calibrate",
            "torque/speed mesh without compensation, for alpha, beta and cogging",
            CalibrateConfig(),
            make="motord.experiments.calibration.plan:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            "calibrate",
            "Identify gains, offsets and cogging torque; -o writes the calibration file.",
            command="motord.experiments.calibration.command:ANALYSIS",
            figures=(
                FigureKind(
                    "alpha",
                    "",
                    "current gain of each phase",
                    value="alpha",
                    stderr="alpha_stderr",
                    freedom="degrees_of_freedom.alpha",
                    budget="alpha",
                    by=("phase",),
                ),
                FigureKind(
                    "alpha_spread",
                    "",
                    "largest current gain less the smallest",
                    value="alpha",
                    stderr="alpha_stderr",
                    freedom="degrees_of_freedom.alpha",
                    budget="alpha",
                    by=("phase",),
                    combine="spread",
                ),
                FigureKind(
                    "beta_A",
                    "A",
                    "current offset of each phase",
                    value="beta_A",
                    stderr="beta_stderr_A",
                    freedom="degrees_of_freedom.beta_A",
                    budget="beta_A",
                    by=("phase",),
                ),
                FigureKind(
                    "delta_epsilon",
                    "",
                    "common gain of torque and current sensors",
                    value="delta_epsilon",
                    freedom="degrees_of_freedom.delta_epsilon",
                    budget="delta_epsilon",
                ),
                FigureKind(
                    "cogging_Nm",
                    "Nm",
                    "amplitude of each order of the cogging torque",
                    value="amplitude_Nm",
                    stderr="stderr_Nm",
                    freedom="degrees_of_freedom",
                    budget="cogging_Nm",
                    rows="tau_cog_harmonics",
                    by=("order",),
                ),
            ),
            schema="motord.calibration/1",
        ),
    ),
    position=20,
)
