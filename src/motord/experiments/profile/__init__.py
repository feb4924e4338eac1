"""Torque and speed over time from a file, played on the bench: how it follows, and the energy."""

from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.figures import with_ends
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
                with_ends("speed_rms_Hz", "speed error, RMS, mean over the cycles"),
                with_ends("torque_rms_Nm", "torque error, RMS, mean over the cycles"),
                with_ends("energy_J", "mechanical energy, mean over the cycles"),
            ),
            schema="motord.profile/1",
        ),
    ),
    position=75,
)
