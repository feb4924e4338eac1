"""A value at its bound, as a time constant of zero, is worked with, or a message says why not."""

from collections.abc import Iterator
from contextlib import suppress
from typing import Any, Union, get_args, get_origin

import annotated_types
import pytest
from pydantic import BaseModel, ValidationError

from motord.config import Config, ConfigError, load
from motord.config.experiments import plan_kinds
from motord.experiments.plans import build
from motord.sequencing import PlanError
from motord.virtual import PlanFailed, VirtualBench, run_plan

SHORT = {"torques_Nm": [2.0], "speeds_Hz": [1.0], "turns": 2, "settle_s": 0.0, "compensate": "off"}


def bounds(model: type[BaseModel], *names: str) -> Iterator[tuple[tuple[str, ...], float]]:
    """Yield each number of a table and of those in it, with each bound that it may have itself."""
    for name, field in model.model_fields.items():
        path, annotation = (*names, name), field.annotation
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            yield from bounds(annotation, *path)
            continue
        for limit in (*field.metadata, *_metadata(annotation)):
            if isinstance(limit, annotated_types.Ge | annotated_types.Le):
                value = limit.ge if isinstance(limit, annotated_types.Ge) else limit.le
                yield path, float(value) if annotation is float else value


def _metadata(annotation: Any) -> Iterator[Any]:
    if get_origin(annotation) is Union or type(annotation).__name__ == "UnionType":
        for part in get_args(annotation):
            yield from getattr(part, "__metadata__", ())


TABLES = ("loop", "inverter", "bridge", "torque_sensor", "brake", "drive", "motor", "limits")
CASES = [(path, value) for path, value in bounds(Config) if path[0] in TABLES]
PLANS = [
    (name, path, value)
    for name, kind in plan_kinds().items()
    for path, value in bounds(type(kind.settings))
]


def played(path: tuple[str, ...], value: float) -> str:
    """Take a point on the packaged bench with a value changed; return why not, "" if it was."""
    content: dict[str, Any] = load().model_dump()
    table = content
    for name in path[:-1]:
        table = table[name]
    table[path[-1]] = value
    try:
        config = Config.model_validate(content)
        plan = build("verify", config, SHORT)
        run_plan(VirtualBench(config, seed=1), plan, lambda ticks, truth: None)
    except (ValidationError, ConfigError, PlanError, PlanFailed) as error:
        return str(error)
    return ""


NOT_OF_THE_RIG = {
    (("motor", "pole_pairs"), 1): "is the rotor free?",  # currents go to the wrong phases
    (("motor", "pole_pairs"), 200): "is the rotor free?",
    (("motor", "encoder_offset_rad"), -100.0): "TORQUE_IMPLAUSIBLE",
    (("motor", "encoder_offset_rad"), 100.0): "TORQUE_IMPLAUSIBLE",
    (("brake", "torque_max_Nm"), 1e6): "OVER_SPEED",  # so strong a brake is hardly excited
    (("brake", "excitation_time_constant_s"), 60.0): "is the rotor free?",
    (("brake", "temperature_max_C"), -273.0): "not enabled",  # it is warmer than that
    (("limits", "trip_temperature_C"), -273.0): "not enabled",
}
"""What comes of values that say of the packaged rig what it is not."""


@pytest.mark.kernel
@pytest.mark.parametrize(("path", "value"), CASES, ids=lambda given: str(given))
def test_a_bench_with_a_value_at_its_bound(path: tuple[str, ...], value: float) -> None:
    why = played(path, value)
    if otherwise := NOT_OF_THE_RIG.get((path, value)):
        assert otherwise in why
    else:
        assert not why or path[-1] in why


@pytest.mark.kernel
@pytest.mark.parametrize(
    "path", [("brake", "excitation_time_constant_s"), ("torque_sensor", "highpass_time_constant_s")]
)
def test_what_follows_at_once_is_worked_with(path: tuple[str, ...]) -> None:
    assert (path, 0.0) in CASES
    assert played(path, 0.0) == ""


@pytest.mark.parametrize(("name", "path", "value"), PLANS, ids=lambda given: str(given))
def test_a_plan_with_a_setting_at_its_bound(name: str, path: tuple[str, ...], value: float) -> None:
    settings: Any = value
    for part in reversed(path):
        settings = {part: settings}
    with suppress(PlanError):
        build(name, load(), settings)
