"""Are wrong signals noticed? `python -m tests.campaigns.wrong_signals [EXPERIMENT ...]`.

Each experiment is recorded on the simulated rig in virtual time. Then one column of its ticks is
made wrong (scale, sign, swapped phases, delay, mains, spikes, frozen, clock, lost ticks, lines of
the encoder), and the recording analysed again. A figure that has moved out of both 95 % intervals
must come with a finding, or the analysis must be refused. `--known` lists what no analysis of that
recording can see, and why. Prints a line for each change that is not noticed; `--all` for each.
Exits with 1 if a change is not noticed and not known to be invisible, or if an analysis ends with
another error than one for the user.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np

from motord.config.experiments import analysis_kinds
from motord.experiments.analysis import Analysis
from motord.experiments.plans import build
from motord.experiments.subject import AnalysisError, Recordings
from motord.identification import IdentifyError
from motord.recording.errors import RecordError
from motord.results.figures import ResultFigure, figures
from motord.simulate import PlanSource, record_plan
from motord.virtual import processors
from tests.support.wrong_signals import CHANGES, change_recording

ROOT = Path(__file__).resolve().parents[2]
SEED = 7
MOVED = 1.0
"""Sums of both half-widths beyond which a figure has moved."""

USER_ERRORS = (AnalysisError, IdentifyError, RecordError)


@dataclass(frozen=True)
class Case:
    """An experiment: plan with settings, bench file, options of its analysis."""

    plan: str
    analysis: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    bench: Path | None = None
    options: Mapping[str, Any] = field(default_factory=dict)


POINTS = {"torques_Nm": [1.0, 3.0, 5.0], "speeds_Hz": [0.5, 0.7, 0.9], "turns": 6, "settle_s": 0.3}
CASES = {
    "align": Case("align"),
    "calibrate": Case("calibrate", settings=POINTS),
    "verify": Case("verify", settings=POINTS),
    "cogging": Case("cogging", settings={"turns": 6}),
    "back-emf": Case("back-emf", settings={"turns": 6}),
    "torque-speed": Case("torque-speed", bench=ROOT / "config" / "efficiency.toml"),
    "thermal": Case("thermal", bench=ROOT / "config" / "thermal.toml"),
    "inertia-acceleration": Case("inertia-acceleration", "inertia"),
    "friction": Case("friction", options={"inertia": Path("/tmp/ws/inertia.json")}),
    "sensitivity": Case("sensitivity"),
    "profile": Case("profile"),
    "soak": Case("soak"),
}


@dataclass(frozen=True)
class Answer:
    """What an analysis says: figures, names of findings; or why it refuses; or its fault."""

    figures: Mapping[str, ResultFigure] = field(default_factory=dict)
    findings: tuple[str, ...] = ()
    refused: str = ""
    fault: str = ""


def record(name: str, folder: Path) -> Path:
    """Record an experiment."""
    case = CASES[name]
    source = PlanSource.of(case.bench)
    path = folder / f"{name}.mcap"
    record_plan(source, build(case.plan, source.config, case.settings), path, SEED)
    return path


def analyse(name: str, path: Path) -> Answer:
    """Analyse a recording as `motord analyse` does."""
    analysis: Analysis[Any] = resolve_name(analysis_kinds()[CASES[name].analysis or name].command)
    recordings = Recordings.open([path])
    try:
        content = analysis.to_json(analysis.estimate(recordings, **CASES[name].options), recordings)
    except USER_ERRORS as error:
        return Answer(refused=str(error))
    except Exception as error:
        return Answer(fault=f"{type(error).__name__}: {error}")
    return Answer(
        {one.field: one for one in figures(content)},
        tuple(f"{one['name']} ({one['severity']})" for one in content["findings"]),
    )


def asked(folder: Path, name: str, change: str) -> Answer:
    """Change a recording, analyse it, remove it."""
    path = folder / f"{name}-{list(CHANGES).index(change)}.mcap"
    change_recording(folder / f"{name}.mcap", path, CHANGES[change])
    try:
        return analyse(name, path)
    finally:
        path.unlink()


def moved(clean: Answer, changed: Answer) -> Iterator[str]:
    """Yield the figures whose intervals no longer meet."""
    for name, one in clean.figures.items():
        other = changed.figures.get(name)
        ends = (one.low, one.high, other.low, other.high) if other else (None,)
        if other is None or any(end is None for end in ends):
            continue
        halves = (one.high - one.low + other.high - other.low) / 2  # type: ignore[operator]
        apart = other.value - one.value
        if one.unit == "rad":
            apart = (apart + np.pi) % (2 * np.pi) - np.pi
        if abs(apart) > halves:
            yield (
                f"{name} {one.value:.5g} +- {(one.high - one.low) / 2:.2g} -> "  # type: ignore[operator]
                f"{other.value:.5g} +- {(other.high - other.low) / 2:.2g} {one.unit}"  # type: ignore[operator]
            )


def line(clean: Answer, changed: Answer) -> tuple[str, str]:
    """Return in a word what became of a change, and the particulars."""
    if changed.fault:
        return "FAULT", changed.fault
    if changed.refused:
        return "refused", changed.refused[:110]
    new = sorted(set(changed.findings) - set(clean.findings))
    gone = list(moved(clean, changed))
    if not gone:
        return "same", ", ".join(new)
    return ("found" if new else "SILENT"), f"{', '.join(new)}; {len(gone)} moved: {gone[0]}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("experiments", nargs="*", default=list(CASES))
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--folder", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary, processors() as pool:
        folder = options.folder or Path(temporary)
        names = options.experiments
        list(
            pool.map(
                partial(record, folder=folder),
                [n for n in names if not (folder / f"{n}.mcap").exists()],
            )
        )
        for name in names:
            clean = analyse(name, folder / f"{name}.mcap")
            said = clean.refused or clean.fault or ", ".join(clean.findings)
            print(f"{name}: {len(clean.figures)} figures; {said}", flush=True)
            for change, answer in zip(
                CHANGES, pool.map(partial(asked, folder, name), CHANGES), strict=True
            ):
                what, particulars = line(clean, answer)
                if options.all or what in ("SILENT", "FAULT"):
                    print(f"  {what:8} {change}: {particulars}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
