"""Iterative learning control: corrections of the torque learned at the points of the mesh."""

from motord.config.experiments import experiment
from motord.config.plans import LearnConfig

EXPERIMENT = experiment(
    __name__,
    "learn",
    settings=LearnConfig(),
    plan="the mesh with the calibration applied, once, to learn the residual of each point",
    analysis="Learn the residual torque ripple of a pass; -o writes the calibration to apply next.",
    schema="motord.learn/1",
    position=80,
)
