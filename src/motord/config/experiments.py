"""The registry of experiments: what bench file, command line and service need to know of each.

An experiment is a package that holds an `Experiment` and is announced by an entry point in the
group `motord.experiments`; motord's own and those of other packages alike. What is announced is
small: plans and analyses are named as `module:object` and imported when they are used.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import BeforeValidator, ConfigDict, Field, SerializeAsAny, create_model

from motord.config.base import Section
from motord.config.figures import FigureKind

GROUP = "motord.experiments"

Settings = TypeVar("Settings", bound=Section)


@dataclass(frozen=True)
class PlanKind:
    """A plan that can be started.

    settings: the section `[plans.<name>]` with its defaults; make: `module:function` that makes a
    `sequencing.Plan` of a `Config` and the settings that were given.
    """

    name: str
    summary: str
    settings: Section
    make: str

    def maker(self) -> Callable[..., Any]:
        """Return what makes the plan. Raises ImportError, AttributeError."""
        make: Callable[..., Any] = resolve_name(self.make)
        return make


@dataclass(frozen=True)
class AnalysisKind:
    """A kind of `motord analyse`. command: `module:object`, an `experiments.analysis.Analysis`.

    aliases: further names of the command, which its help does not list. schema: what its JSON names
    as its `schema`, by which `motord results add` knows it; "" if it names none. figures: those of
    its result that have an uncertainty.
    """

    name: str
    summary: str
    command: str
    aliases: tuple[str, ...] = ()
    figures: tuple[FigureKind, ...] = ()
    schema: str = ""

    @property
    def leading(self) -> frozenset[str]:
        """Keys of the quantities that errors without a name are of."""
        return frozenset(one.value for one in self.figures if one.leading)


@dataclass(frozen=True)
class Experiment:
    """An experiment: its plans and its analysis. position: its place in lists, lowest first."""

    plans: tuple[PlanKind, ...] = ()
    analyses: tuple[AnalysisKind, ...] = ()
    position: int = 100


def experiment(
    package: str,
    name: str,
    *,
    settings: Section,
    plan: str,
    analysis: str,
    schema: str,
    position: int,
    figures: tuple[FigureKind, ...] = (),
    make: str = "",
) -> Experiment:
    """Return an experiment of one plan and its analysis, both called `name`.

    package: has `ANALYSIS` in its module `command`, and `make` in its module `plan` unless `make`
    says where else; plan and analysis: their summaries.
    """
    made = PlanKind(name, plan, settings, make or f"{package}.plan:make")
    analysed = AnalysisKind(name, analysis, f"{package}.command:ANALYSIS", (), figures, schema)
    return Experiment((made,), (analysed,), position)


@cache
def _registered() -> tuple[tuple[Experiment, ...], dict[str, str]]:
    """Return the experiments in order, and why others could not be imported, by name."""
    found: list[Experiment] = []
    broken = {}
    for entry in sorted(entry_points(group=GROUP), key=lambda one: one.name):
        try:
            found.append(entry.load())
        except Exception as error:
            broken[entry.name] = f"{entry.value}: {type(error).__name__}: {error}"
    return tuple(sorted(found, key=lambda one: one.position)), broken


def plan_kinds() -> dict[str, PlanKind]:
    """Return the plans of all experiments by name, in order."""
    return {plan.name: plan for experiment in _registered()[0] for plan in experiment.plans}


def analysis_kinds() -> dict[str, AnalysisKind]:
    """Return the analyses of all experiments by name, in order."""
    return {kind.name: kind for experiment in _registered()[0] for kind in experiment.analyses}


def broken_experiments() -> Iterator[str]:
    """Yield which experiments could not be imported, and why."""
    for name, why in _registered()[1].items():
        yield f"experiment {name} cannot be imported: {why}"


class PlansConfig(Section):
    """`[plans.*]`: defaults of each registered plan, under the plan's name."""

    model_config = ConfigDict(
        alias_generator=lambda name: name.replace("_", "-"), populate_by_name=True
    )

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...

    def of(self, name: str, section: type[Settings]) -> Settings:
        """Return the settings of plan `name`, which are a `section`."""
        found = getattr(self, name.replace("-", "_"))
        assert isinstance(found, section)
        return found


@cache
def plans_model() -> type[PlansConfig]:
    """Return the model of `[plans.*]`, with a section for each registered plan."""
    sections: dict[str, Any] = {
        name.replace("-", "_"): (type(plan.settings), plan.settings)
        for name, plan in plan_kinds().items()
    }
    return create_model("RegisteredPlans", __base__=PlansConfig, __module__=__name__, **sections)


def __getattr__(name: str) -> Any:
    if name == "RegisteredPlans":  # pickle looks for a section's class by its name
        return plans_model()
    raise AttributeError(f"module {__name__} has no attribute {name}")


def _validated(given: Any) -> Any:
    return given if isinstance(given, PlansConfig) else plans_model().model_validate(given)


Plans = Annotated[
    SerializeAsAny[PlansConfig],
    BeforeValidator(_validated),
    Field(default_factory=lambda: plans_model()()),
]
"""The field `plans` of a bench, validated by the sections of the plans that are registered."""
