"""Back-EMF of the phases from a rotor driven without current."""

from motord.config import DrivenConfig
from motord.config.experiments import experiment
from motord.config.figures import FigureKind

EXPERIMENT = experiment(
    __name__,
    "back-emf",
    settings=DrivenConfig(speeds_Hz=(0.53, 0.87, 1.37)),
    plan="rotor driven from outside without current, for the back-EMF of the phases",
    make="motord.sequencing.driven_rotor:make_back_emf",
    analysis="Measure the back-EMF; -o writes the table that `[motor] back_emf` may name.",
    schema="motord.back-emf/1",
    position=50,
    figures=(
        FigureKind(
            "back_emf_V_s_per_rad",
            summary="amplitude of each electrical order of the back-EMF, mean of the phases",
            value="amplitude_V_s_per_rad",
            rows="harmonics",
            by=("order",),
        ),
    ),
)
