"""A plan repeated for hours, and the trend of torque, temperatures and timing over them."""

from motord.config.experiments import experiment
from motord.config.figures import FigureKind
from motord.experiments.soak.settings import NAME, SoakConfig

EXPERIMENT = experiment(
    __name__,
    NAME,
    settings=SoakConfig(),
    plan="another plan again and again, for hours, for the trend afterwards",
    analysis="Find drifts of torque, temperatures and timing over the repetitions of a plan.",
    schema="motord.soak/1",
    position=65,
    figures=(
        FigureKind(
            "slope",
            summary="trend of a figure over the repetitions",
            value="value",
            rows="trends",
            by=("name",),
            unit="unit of the figure an hour",
        ),
    ),
)
