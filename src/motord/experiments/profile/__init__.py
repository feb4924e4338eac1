"""Torque and speed over time from a file, played on the bench: how it follows, and the energy."""

from motord.config.experiments import experiment
from motord.config.figures import FigureKind
from motord.experiments.profile.settings import NAME, ProfileConfig

EXPERIMENT = experiment(
    __name__,
    NAME,
    settings=ProfileConfig(),
    plan="torque and speed over time from a CSV file, such as a drive cycle",
    analysis="Compare torque and speed over time with what a profile asked for, and its energy.",
    schema="motord.profile/1",
    position=75,
    figures=(
        FigureKind("speed_rms_Hz", summary="speed error, RMS, mean over the cycles"),
        FigureKind("torque_rms_Nm", summary="torque error, RMS, mean over the cycles"),
        FigureKind("energy_J", summary="mechanical energy, mean over the cycles"),
    ),
)
