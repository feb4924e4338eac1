"""Alignment of phases and encoder: order and direction of the phases, zero of the encoder."""

from motord.config.experiments import experiment
from motord.config.plans import AlignConfig

EXPERIMENT = experiment(
    __name__,
    "align",
    settings=AlignConfig(),
    plan="a current vector turned slowly, for phase order, encoder direction and encoder zero",
    analysis="Find phase order, encoder direction and encoder zero from a run of the plan align.",
    schema="motord.align/1",
    position=10,
)
