"""Torque and speed over time from a file, played on the bench: how it follows, and the energy."""

from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.figures import FigureKind
from motord.experiments.profile.settings import NAME, ProfileConfig

EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            NAME,
            "torque and speed over time from a CSV file, such as a drive cycle",
            ProfileConfig(),
            make="motord.experiments.profile.plan:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            NAME,
            "Compare torque and speed over time with what a profile asked for, and its energy.",
            command="motord.experiments.profile.command:ANALYSIS",
            figures=(
                FigureKind(
                    "speed_rms_Hz",
                    "Hz",
                    "speed error, RMS, mean over the cycles",
                    value="speed_rms_Hz",
                    low="speed_rms_low_Hz",
                    high="speed_rms_high_Hz",
                ),
                FigureKind(
                    "torque_rms_Nm",
                    "Nm",
                    "torque error, RMS, mean over the cycles",
                    value="torque_rms_Nm",
                    low="torque_rms_low_Nm",
                    high="torque_rms_high_Nm",
                ),
                FigureKind(
                    "energy_J",
                    "J",
                    "mechanical energy, mean over the cycles",
                    value="energy_J",
                    low="energy_low_J",
                    high="energy_high_J",
                ),
            ),
            schema="motord.profile/1",
        ),
    ),
    position=75,
)
