"""A plan repeated for hours, and the trend of torque, temperatures and timing over them."""

from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.figures import FigureKind
from motord.experiments.soak.settings import NAME, SoakConfig

EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            NAME,
            "another plan again and again, for hours, for the trend afterwards",
            SoakConfig(),
            make="motord.experiments.soak.plan:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            NAME,
            "Find drifts of torque, temperatures and timing over the repetitions of a plan.",
            command="motord.experiments.soak.command:ANALYSIS",
            figures=(
                FigureKind(
                    "slope",
                    "unit of the figure an hour",
                    "trend of a figure over the repetitions",
                    value="value",
                    stderr="stderr",
                    low="low",
                    high="high",
                    rows="trends",
                    by=("name",),
                ),
            ),
            schema="motord.soak/1",
        ),
    ),
    position=65,
)
