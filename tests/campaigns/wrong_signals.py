"""Are wrong signals noticed? `python -m tests.campaigns.wrong_signals [EXPERIMENT ...]`.

Each experiment is recorded on the simulated rig in virtual time. Then one signal of its ticks is
made wrong (scale, sign, swapped phases, delay, mains, spikes, clock, lost ticks, lines of the
encoder: `tests/support/wrong_signals.py`), and the recording analysed again. Where the analysis is
not refused, a figure that has left its 95 % interval must come with a finding.

Prints a line for each change that is not noticed, `--all` for each. Exits with 1 if one is not
noticed that KNOWN does not list, or if an analysis ends by an error in the program.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from math import pi
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from motord.calibration import load
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

CONFIG = Path(__file__).resolve().parents[2] / "config"
SEED = 7
USER_ERRORS = (AnalysisError, IdentifyError, RecordError)


@dataclass(frozen=True)
class Case:
    """An experiment: its plan with settings, the bench, and results of others that it needs.

    analysis: by default of the plan's name. needs: options of the analysis, by the experiment
    whose result each names; a calibration is in force when the plan is recorded, too.
    """

    settings: Mapping[str, Any] = field(default_factory=dict)
    analysis: str = ""
    bench: Path | None = None
    needs: Mapping[str, str] = field(default_factory=dict)


MESH = {"torques_Nm": [1.0, 3.0, 5.0], "speeds_Hz": [0.5, 0.7, 0.9], "turns": 6, "settle_s": 0.3}
CALIBRATED = {"calibration": "calibrate"}
CASES = {
    "calibrate": Case(MESH),
    "inertia-acceleration": Case(analysis="inertia"),
    "align": Case(),
    "verify": Case(MESH),
    "cogging": Case({"turns": 6}),
    "back-emf": Case({"turns": 6}),
    "friction": Case(needs={"inertia": "inertia-acceleration"}),
    "sensitivity": Case(),
    "profile": Case(),
    "check-calibration": Case(needs=CALIBRATED),
    "learn": Case(MESH, needs=CALIBRATED),
    "torque-speed": Case(bench=CONFIG / "efficiency.toml"),
    "thermal": Case(bench=CONFIG / "thermal.toml"),
}

KNOWN: Mapping[str, tuple[str, ...]] = {
    "a gain within the sensor's tolerance or the limit of 30 %: part of the stated accuracy": (
        "torque * 1.1", "torque's gain drifts 10 %",
    ),
    "nothing else in the recording has a clock": (
        "back-emf: clock 2 % fast", "torque-speed: clock 2 % fast",
        "torque-speed: clock twice as fast", "cogging: clock twice as fast",
    ),
    "without current, nothing tells sign, scale and zero of torque and encoder": (
        "cogging: torque * -1", "cogging: torque in kNm", "cogging: torque * 2",
        "cogging: encoder turned by a quarter period", "cogging: encoder turned by 5 deg el",
        "cogging: encoder backwards", "back-emf: encoder turned by 5 deg el",
    ),
    "the sensor does not pass the mean, and the ripple alone has no scale": (
        "verify: torque in kNm", "verify: torque * 2", "verify: torque 20 ms late",
    ),
    "noise that is alike in all turns of a point is ripple": (
        "profile: torque with mains 5 %", "calibrate: torque with mains 5 %",
    ),
    "an offset or a gain that the sensor of a current may have: what is to be calibrated": (
        "calibrate: current of a + 2 A", "sensitivity: current of a + 2 A",
        "calibrate: current of a * 1.2",
        "profile: current of a + 2 A", "thermal: current of a + 2 A",
    ),
    "a drive may be so slow": ("profile: currents 10 ms late", "thermal: currents 10 ms late"),
    "spikes in a thousandth of the samples act as noise": (
        "calibrate: torque with spikes", "calibrate: currents with spikes",
        "inertia-acceleration: torque with spikes", "torque-speed: torque with spikes",
        "profile: torque with spikes", "thermal: currents with spikes",
    ),
    "drift of the losses within a point alone, by less than its least limit": (
        "torque-speed: 50 ms lost in each second",
    ),
    "peaks of noise on a steady current": ("thermal: currents clipped",),
}  # fmt: skip
"""By what an analysis cannot see: changes, or "experiment: change"."""


@dataclass(frozen=True)
class Answer:
    """What an analysis says: figures, names of findings; or why it refuses; or its fault."""

    figures: Mapping[str, ResultFigure] = field(default_factory=dict)
    findings: tuple[str, ...] = ()
    refused: str = ""
    fault: str = ""


def options_of(name: str, folder: Path) -> dict[str, Path]:
    """Return the options that name results of other experiments."""
    return {option: folder / f"{other}.json" for option, other in CASES[name].needs.items()}


def record(name: str, folder: Path) -> None:
    """Record an experiment."""
    case, source = CASES[name], PlanSource.of(CASES[name].bench)
    applied = options_of(name, folder).get("calibration")
    plan = build(name, source.config, case.settings)
    record_plan(source, plan, folder / f"{name}.mcap", SEED, load(applied) if applied else None)


def analyse(name: str, folder: Path, path: Path, *, keep: bool = False) -> Answer:
    """Analyse a recording as `motord analyse` does; keep the result for other experiments."""
    kind = analysis_kinds()[CASES[name].analysis or name]
    analysis: Analysis[Any] = resolve_name(kind.command)
    recordings = Recordings.open([path])
    try:
        result = analysis.estimate(recordings, **options_of(name, folder))
        content = analysis.to_json(result, recordings)
    except USER_ERRORS as error:
        return Answer(refused=str(error))
    except Exception as error:
        return Answer(fault=f"{type(error).__name__}: {error}")
    if keep:
        kept = folder / f"{name}.json"
        (analysis.save or (lambda _, to: to.write_text(json.dumps(content))))(result, kept)
    return Answer(
        {one.field: one for one in figures(content)},
        tuple(f"{one['name']} ({one['severity']})" for one in content["findings"]),
    )


def asked(folder: Path, name: str, change: str) -> Answer:
    """Change a recording, analyse it, remove it."""
    path = folder / f"{name}-{list(CHANGES).index(change)}.mcap"
    change_recording(folder / f"{name}.mcap", path, CHANGES[change])
    try:
        return analyse(name, folder, path)
    finally:
        path.unlink()


def moved(clean: Answer, changed: Answer) -> Iterator[str]:
    """Yield the figures that are apart by more than both half-widths."""
    for name, one in clean.figures.items():
        other = changed.figures.get(name)
        if other is None or None in (one.low, one.high, other.low, other.high):
            continue
        halves = [(each.high - each.low) / 2 for each in (one, other)]  # type: ignore[operator]
        apart = other.value - one.value
        if one.unit == "rad":
            apart = (apart + pi) % (2 * pi) - pi
        if abs(apart) > sum(halves):
            was, now = (
                f"{each.value:.5g} +- {half:.2g}"
                for each, half in zip((one, other), halves, strict=True)
            )
            yield f"{name} {was} -> {now} {one.unit}"


def judged(name: str, change: str, clean: Answer, changed: Answer) -> tuple[str, str]:
    """Return in a word what became of a change, and the particulars."""
    if changed.fault or changed.refused:
        return ("FAULT", changed.fault) if changed.fault else ("refused", changed.refused)
    new = ", ".join(sorted(set(changed.findings) - set(clean.findings)))
    gone = list(moved(clean, changed))
    if not gone:
        return "same", new
    what = "found" if new else "SILENT"
    for why, changes in KNOWN.items():
        if not new and (change in changes or f"{name}: {change}" in changes):
            what, new = "known", why
    return what, f"{new}; {len(gone)} moved: {gone[0]}"


def run(name: str, folder: Path, pool: ProcessPoolExecutor, *, show: bool) -> bool:
    """Record and analyse an experiment with all changes; return whether all is as it must be."""
    pool.submit(record, name, folder).result()
    clean = analyse(name, folder, folder / f"{name}.mcap", keep=True)
    said = clean.refused or clean.fault or ", ".join(clean.findings)
    print(f"{name}: {len(clean.figures)} figures; {said}", flush=True)
    answers = pool.map(partial(asked, folder, name), CHANGES)
    good = bool(clean.figures)
    for change, answer in zip(CHANGES, answers, strict=True):
        what, particulars = judged(name, change, clean, answer)
        good = good and what not in ("SILENT", "FAULT")
        if show or what in ("SILENT", "FAULT"):
            print(f"  {what:8} {change}: {particulars}", flush=True)
    return good


def main() -> int:
    """Run the experiments and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("experiments", nargs="*", choices=[[], *CASES], default=[])
    parser.add_argument("--all", action="store_true", help="a line for each change")
    options = parser.parse_args()
    chosen = options.experiments or list(CASES)
    needed = {other for name in chosen for other in CASES[name].needs.values()}
    with tempfile.TemporaryDirectory() as temporary, processors() as pool:
        folder = Path(temporary)
        names = [name for name in CASES if name in chosen or name in needed]
        good = [run(name, folder, pool, show=options.all) for name in names]
    return int(not all(good))


if __name__ == "__main__":
    sys.exit(main())
