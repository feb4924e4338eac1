"""What a kind of `motord analyse` is made of; the command line makes a command of each.

An experiment's `command.py` names its estimate, with the options that it takes, its report and
what the terminal shows; opening recordings, options that all share, files and errors are common.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from motord.config.unit_suffixes import split_unit
from motord.experiments.recording_checks import show_damage
from motord.findings import Finding
from motord.intervals import IntervalEstimate

if TYPE_CHECKING:
    from motord.experiments.subject import Recordings
    from motord.report.html import Page
    from motord.report.text import TextTable

Result = TypeVar("Result")


def encode(value: Any) -> Any:
    """Return a result as JSON has it: the one encoder of all experiments.

    Of a dataclass, the fields and properties that its class attribute `JSON` names, by default all
    fields; "name=path.of.it" gives what has another name here, null where an object on the path is
    None. Of an array its values; of an `IntervalEstimate` x_Nm besides its value x_stderr_Nm,
    x_low_Nm and x_high_Nm.
    """
    if is_dataclass(value) and not isinstance(value, type):
        names = getattr(value, "JSON", None) or [one.name for one in fields(value)]
        pairs = (one.partition("=") for one in names)
        found = {name: _at(value, path or name) for name, _, path in pairs}
        return {key: part for name, one in found.items() for key, part in _encoded(name, one)}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): encode(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [encode(part) for part in value]
    return value


def _at(value: Any, path: str) -> Any:
    """Return what is at a path of attributes, None behind one that is None."""
    for name in path.split("."):
        value = None if value is None else getattr(value, name)
    return value


def _encoded(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the keys of a field of an object, and what JSON has of each."""
    if not isinstance(value, IntervalEstimate):
        yield name, encode(value)
        return
    x, unit = split_unit(name)
    for role in ("", "stderr", "low", "high"):
        yield "_".join(filter(None, (x, role, unit))), getattr(value, role or "value")


def json_of(schema: str, *motor: str) -> Callable[[Any, "Recordings"], dict[str, Any]]:
    """Return what makes the JSON of a result, after what it is of.

    motor: fields of `[motor]`; without, the motor's name alone, and its serial number by itself.
    """

    def json(result: Any, recordings: "Recordings") -> dict[str, Any]:
        subject = recordings.subject
        named = {name: getattr(subject.motor, name) for name in motor}
        alone = {"motor": subject.motor.name, "serial": subject.motor.serial}
        return {
            "schema": schema,
            "bench": subject.bench,
            **({"motor": named} if named else alone),
            "runs": recordings.names,
            **encode(result),
        }

    return json


@dataclass(frozen=True)
class Analysis(Generic[Result]):
    """A kind of `motord analyse`.

    estimate: `Recordings` to result; its further parameters, annotated for typer, are the command's
    own options, but for `command`, the name by which it was called. json: the result as `--json`
    prints it; text: what the terminal shows. report: its page, by default made by `report` of the
    module `report` of the estimate's package. save: writes what `-o` asks for, by default the JSON,
    with `indent`. details: more of the command's help. outputs: options that
    name files to write, which are no settings of the analysis; edited: those of them whose file is
    changed, which may be the bench file.

    Where the data depart from the model the result says so in its `findings`, a field or property.
    They are shown here for all: `to_json`, `page` and `lines` are what the three give, with them.
    """

    estimate: Callable[..., Result]
    json: Callable[[Result, "Recordings"], dict[str, Any]]
    text: Callable[[Result, "Recordings"], "Iterable[str | TextTable]"] = field(kw_only=True)
    report: Callable[[Result, "Recordings"], "Page"] | None = field(default=None, kw_only=True)
    save: Callable[[Result, Path], None] | None = None
    indent: int | None = 1
    details: str = ""
    needs_recordings: bool = True
    outputs: tuple[str, ...] = ()
    edited: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.report is None and find_spec(self._report_module) is None:
            raise TypeError(f"{self._report_module} is not there: give Analysis a report")

    @property
    def _report_module(self) -> str:
        """Name of the module `report` next to that of the estimate."""
        return ".".join((*self.estimate.__module__.split(".")[:-1], "report"))

    def to_json(self, result: Result, recordings: "Recordings") -> dict[str, Any]:
        """Return the result as JSON, with its findings, and what is missing of its recordings."""
        damage = {str(run.path): str(run.damage) for run in recordings.runs if run.damage}
        findings = {"findings": encode(findings_of(result))}
        return {
            **self.json(result, recordings),
            **findings,
            **({"damage": damage} if damage else {}),
        }

    def page(self, result: Result, recordings: "Recordings") -> "Page":
        """Return the result's page, with its findings, and what is missing of its recordings."""
        report = self.report or resolve_name(f"{self._report_module}:report")
        page: Page = report(result, recordings)
        show_damage(page, recordings.runs)
        page.findings(findings_of(result))
        return page

    def lines(self, result: Result, recordings: "Recordings") -> "Iterator[str | TextTable]":
        """Yield what the terminal shows of the result, then its findings."""
        yield from self.text(result, recordings)
        for finding in findings_of(result):
            yield f"- {finding.to_text()}"


def findings_of(result: Any) -> tuple[Finding, ...]:
    """Return the findings of a result; none for results that have no such field."""
    return tuple(getattr(result, "findings", None) or ())
