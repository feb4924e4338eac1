"""A capture that is spoiled in any way: each analysis of several goes on and says so, or why not.

No figure is beyond its interval by it: it is left out, or only samples of it are.
"""

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from motord.config.experiments import analysis_kinds, resolve_name
from motord.experiments.analysis import Analysis
from motord.experiments.subject import AnalysisError, Recordings
from motord.identification import IdentifyError
from motord.identification.rotor.left_out import PART
from motord.recording.reader import Run
from motord.results.figures import figures
from motord.schema import joined, rows_of
from tests.support.plan_recordings import PLANS, PlanFiles

pytestmark = pytest.mark.usefixtures("no_search_for_lines")

COUNTS = 4096
SPOILED = 1
"""Place of the capture that is spoiled among the operating points."""

ONE_COURSE = {"thermal", "inertia-oscillation"}
"""Analyses of one course, or of what is released by hand, not of several captures."""

SEVERAL = [name for name in PLANS if name not in ONE_COURSE]

NO_INTERVALS = {"learn", "soak"}
"""Analyses of which a recording of a few points states no interval."""

OF_THOSE_LEFT = "rms_error_percent."
"""Figures of the mean and the largest over the points that are left: another set, another value."""

SPANS_BY_NUMBER = {"cogging", "back-emf"}
"""Analyses that name spans by the number of their point over all recordings."""


def without_part_of_a_turn(own: np.ndarray) -> np.ndarray:
    """Leave out the samples of 0.6 turns: the shorter way round is the wrong one."""
    turned = np.abs(np.unwrap(own["encoder_count"].astype(int), period=COUNTS)) / COUNTS
    turned -= turned.min()
    begin = turned.max() / 2
    return rows_of(own, (turned < begin) | (turned > begin + 0.6))


def changed(name: str, change: Callable[[np.ndarray], Any], own: np.ndarray) -> np.ndarray:
    own[name] = change(own[name])
    return own


def misread(count: np.ndarray) -> np.ndarray:
    count[5:-5:97] ^= 1024
    return count


def unknown_at_times(torque_Nm: np.ndarray) -> np.ndarray:
    torque_Nm[::50] = np.nan
    return torque_Nm


WAYS: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "lost turns": without_part_of_a_turn,
    "dead torque sensor": partial(changed, "torque_Nm", lambda _: 0.1),
    "torque not recorded": partial(changed, "torque_Nm", lambda _: np.nan),
    "torque unknown at times": partial(changed, "torque_Nm", unknown_at_times),
    "misread counts": partial(changed, "encoder_count", misread),
    "truncated": lambda own: own[: own.size // 3],
    "too short": lambda own: own[:7],
    "no ticks": lambda own: own[:0],
    "standing rotor": partial(changed, "encoder_count", lambda count: count[0]),
}

SAMPLES_ALONE = "torque unknown at times"
"""A way that leaves out samples, and nothing is to be said of the capture."""

ONE_OF_EACH = ("lost turns", "torque not recorded", "misread counts", "truncated", "no ticks")
SLOW = {"calibrate", "friction", "sensitivity"}
"""Analyses of a second each, tried in one way of each kind."""


@lru_cache(maxsize=1)
def sound_ticks(path: Path) -> np.ndarray:
    """Return the ticks of a recording, which are read once for all ways to spoil them."""
    ticks = Run(path).ticks()
    ticks.flags.writeable = False
    return ticks


@cache
def sound_points(path: Path) -> list[dict[str, Any]]:
    """Return the operating points of a recording, which are read once; see `sound_ticks`."""
    return Run(path).operating_points()


class SpoiledRun(Run):
    """A recording with other ticks than its file has."""

    def __init__(self, path: Path, spoil: Callable[[np.ndarray], np.ndarray]) -> None:
        super().__init__(path)
        ticks = sound_ticks(path)
        point = self.operating_points()[SPOILED]
        own = (ticks["plan_point"] == point["index"]) & (ticks["t_ns"] >= point["t_start_ns"])
        own &= ticks["t_ns"] <= point["t_end_ns"]
        [at] = np.nonzero(own)
        self._ticks = joined([ticks[: at[0]], spoil(rows_of(ticks, own)), ticks[at[-1] + 1 :]])

    def operating_points(self) -> list[dict[str, Any]]:
        return deepcopy(sound_points(self.path))

    def ticks(self, columns: Any = None, **bounds: int) -> np.ndarray:
        t_ns = self._ticks["t_ns"]
        first, end = bounds.get("from_ns", t_ns[0]), bounds.get("to_ns", t_ns[-1])
        chosen = rows_of(self._ticks, (t_ns >= first) & (t_ns <= end))
        return chosen if columns is None else chosen[list(columns)].copy()


@dataclass(frozen=True)
class Outcome:
    """What an analysis came to: its figures with intervals, by name, and what it says."""

    intervals: Mapping[str, tuple[float, float]]
    said: str
    failed: bool = False


def outcome(name: str, run: Run, options: Mapping[str, Path]) -> Outcome:
    kind = analysis_kinds()[name]
    analysis: Analysis[Any] = resolve_name(kind.command)
    recordings = Recordings((run,))
    try:
        content = analysis.to_json(analysis.estimate(recordings, **options), recordings)
    except (AnalysisError, IdentifyError) as error:
        return Outcome({}, str(error), failed=True)
    found = {one.field: (one.low, one.high) for one in figures(content, kind.leading)}
    known = {
        key: one
        for key, one in found.items()
        if None not in one and not key.rpartition(".")[2].isdigit()  # a place, not a name
    }
    left_out = [one for one in content.get("left_out", ()) if PART not in str(one)]  # all have it
    said = (*(one["meaning"] for one in content["findings"]), left_out)
    return Outcome(known, str(said))


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> PlanFiles:
    return PlanFiles(tmp_path_factory.mktemp("plans"))


def test_every_analysis_of_several_captures_is_tried() -> None:
    assert {*SEVERAL} == {*analysis_kinds()} - ONE_COURSE


@pytest.mark.parametrize(
    ("name", "way"),
    [(name, way) for name in SEVERAL for way in (ONE_OF_EACH if name in SLOW else WAYS)],
)
def test_a_spoiled_capture_is_named_and_changes_no_figure(
    files: PlanFiles, name: str, way: str
) -> None:
    path, options = files.recording(name), files.options(name)
    sound = files.known(name, lambda: outcome(name, Run(path), options))
    assert sound.intervals or name in NO_INTERVALS
    found = outcome(name, SpoiledRun(path, WAYS[way]), options)
    point = sound_points(path)[SPOILED]
    labels = (
        f"{point['torque_Nm']:g} Nm, {point['speed_Hz']:g} Hz", f"point {SPOILED + 1}",
        f"{name} {SPOILED + 1}", f"{point['index'] + 1}: ",
    )  # fmt: skip
    by_file = path.name in found.said or name in SPANS_BY_NUMBER
    labelled = any(label in found.said for label in labels)
    unharmed = not found.failed and found.intervals.keys() == sound.intervals.keys()
    unsaid = way == SAMPLES_ALONE or name not in NO_INTERVALS
    assert (labelled and by_file) or (unharmed and (labelled or unsaid)), found.said
    for field, interval in found.intervals.items():
        if field in sound.intervals and not field.startswith(OF_THOSE_LEFT):
            assert overlap(interval, sound.intervals[field], angles="phase" in field), field


def overlap(one: tuple[float, float], other: tuple[float, float], *, angles: bool) -> bool:
    """Return whether intervals overlap, those of angles (rad) but for whole turns."""
    turned = (-2 * np.pi, 0.0, 2 * np.pi) if angles else (0.0,)
    return any(one[0] + by <= other[1] and one[1] + by >= other[0] for by in turned)
