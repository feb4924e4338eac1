"""Every experiment finds the same of a motor, however encoder and cables are mounted on it.

One bench is as packaged; of the other the encoder counts backwards, from another angle, and not in
a power of two, and two phases are exchanged. Motor and noise are the same.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from motord.config.experiments import AnalysisKind, analysis_kinds, plan_kinds, resolve_name
from motord.experiments.analysis import Analysis
from motord.experiments.subject import Recordings
from motord.recording.reader import open_run
from motord.results.figures import ResultFigure, figures
from motord.simulate import PlanSource
from tests.support.plan_recordings import PLANS, Mounting, PlanFiles

pytestmark = pytest.mark.usefixtures("no_search_for_lines")

MIRRORED = Mounting(counts=3600, direction=-1, offset_rad=1.7, phase_order="acb")
BACKWARDS = Mounting(direction=-1)

BY_COUNT = {"calibrate", "cogging"}
"""Analyses whose phases of the cogging torque are over the counts."""

NO_INTERVALS = {"soak"}

SEEN_IN_BOTH = 0.9
"""Part of the figures with intervals that both have: what is not seen is not listed."""

OF_CALIBRATION = {"check-calibration", "learn"}
"""Analyses with the calibration alone that was in force, which names the encoder's direction."""

Found = tuple[Mapping[str, ResultFigure], set[str]]
"""Figures by name, and the names of the findings."""


def kind_of(name: str) -> AnalysisKind:
    return next(kind for kind in analysis_kinds().values() if name in (kind.name, *kind.aliases))


def found(name: str, recordings: Recordings, options: Mapping[str, Path]) -> Found:
    kind = kind_of(name)
    analysis: Analysis = resolve_name(kind.command)
    content = analysis.to_json(analysis.estimate(recordings, **options), recordings)
    known = {one.field: one for one in figures(content, kind.leading)}
    return known, {one["name"] for one in content["findings"]}


def found_of(name: str, files: PlanFiles) -> Found:
    recordings = Recordings((open_run(files.recording(name)),))
    return files.known(name, lambda: found(name, recordings, files.options(name)))


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> PlanFiles:
    return PlanFiles(tmp_path_factory.mktemp("plain"))


@pytest.fixture(scope="module")
def mirrored(tmp_path_factory: pytest.TempPathFactory) -> PlanFiles:
    return PlanFiles(tmp_path_factory.mktemp("mirrored"), MIRRORED)


@pytest.fixture(scope="module")
def backwards(tmp_path_factory: pytest.TempPathFactory) -> PlanFiles:
    return PlanFiles(tmp_path_factory.mktemp("backwards"), BACKWARDS)


def test_every_plan_and_every_analysis_is_tried() -> None:
    assert {one.plan for one in PLANS.values()} == {*plan_kinds()}
    assert {kind_of(name).name for name in PLANS} == {*analysis_kinds()}


def turned_rad(name: str, field: str) -> float:
    """Return by how much the mounting turns an angle."""
    if field == "encoder_offset_rad":
        return MIRRORED.offset_rad
    order = re.search(r"harmonics\.(\d+)\.phase_rad$", field)
    return int(order[1]) * MIRRORED.offset_rad if order and name in BY_COUNT else 0.0


def half_width(one: ResultFigure) -> float:
    assert one.low is not None
    assert one.high is not None
    return (one.high - one.low) / 2


def overlap(name: str, one: ResultFigure, other: ResultFigure) -> bool:
    """Return whether the intervals of a figure on the plain and the mirrored bench overlap."""
    off = other.value - one.value - turned_rad(name, one.field)
    if one.field == "encoder_offset_rad":  # any pole pair of the motor will do
        off = math.remainder(off, 2 * math.pi / PlanSource.of().config.motor.pole_pairs)
    elif "phase" in one.field:
        off = math.remainder(off, 2 * math.pi)
    return abs(off) <= half_width(one) + half_width(other)


@pytest.mark.parametrize("name", PLANS)
def test_a_mirrored_bench_has_the_same_figures(
    name: str, plain: PlanFiles, mirrored: PlanFiles
) -> None:
    (known, said), (known_mirrored, said_mirrored) = (
        found_of(name, files) for files in (plain, mirrored)
    )
    stated, stated_mirrored = (
        {field: one for field, one in each.items() if one.low is not None}
        for each in (known, known_mirrored)
    )
    common = stated.keys() & stated_mirrored.keys()
    assert common or name in NO_INTERVALS
    pairs = [(stated[field], stated_mirrored[field]) for field in common]
    assert [pair for pair in pairs if not overlap(name, *pair)] == []
    assert len(common) >= SEEN_IN_BOTH * max(len(stated), len(stated_mirrored))
    assert said == said_mirrored


@pytest.mark.parametrize("name", [name for name in PLANS if name not in OF_CALIBRATION])
def test_recorded_counts_are_not_turned_round_again(
    name: str, plain: PlanFiles, backwards: PlanFiles
) -> None:
    """They rise forwards whichever way the encoder counts, so no figure depends on that."""
    recordings = Recordings((open_run(plain.recording(name)),))
    motor = recordings.subject.motor.model_copy(update={"encoder_direction": -1})
    recordings.__dict__["subject"] = replace(recordings.subject, motor=motor)
    known, said = found(name, recordings, backwards.options(name))
    expected, said_plain = found_of(name, plain)
    differing = [field for field, one in expected.items() if known.get(field) != one]
    assert differing == (["fields.encoder_direction"] if name == "align" else [])
    assert (known.keys(), said) == (expected.keys(), said_plain)
