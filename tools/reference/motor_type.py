"""The page of the motor type: its keys, and the figures that limits can be set for."""

from tools.reference.bench_file import Tables, sections
from tools.reference.markdown import code, page, table

from motord.config.experiments import analysis_kinds
from motord.verdict.motor_type import FigureLimit, MotorType, PlanToRun

ABOUT = """The file of `motord test MOTOR-TYPE` ([how](../how-to/test-motors.md)). An unknown key is
an error that names it with its line."""

FIGURES = """What the results of analyses state with its uncertainty. Keys of `at` select one of
several."""


def motor_type() -> str:
    """Return the page."""
    tables: Tables = {
        "The file": (MotorType, None),
        "[[plan]]": (PlanToRun, None),
        "[[limit]]": (FigureLimit, None),
    }
    rows = [
        (code(kind.name), code(one.name), one.unit, ", ".join(map(code, one.by)), one.summary)
        for kind in analysis_kinds().values()
        if kind.command.startswith("motord.")
        for one in kind.figures
    ]
    figures = table(("analysis", "figure", "unit", "at", "meaning"), rows)
    parts = (*sections(tables), "## Figures", FIGURES, figures)
    return page("The motor type", "motord.verdict.motor_type", ABOUT, *parts)
