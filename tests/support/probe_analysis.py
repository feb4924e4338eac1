"""An analysis that does what the name of its recording says, registered as an experiment.

`kills...` ends the process that analyses it, `raises...` prints and raises, `exits...` raises,
`waits...` waits until the pipe `gate` next to it was written to; of every recording it measures the
mean torque.
"""

import os
import signal
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from motord.config import experiments, load, packaged
from motord.config.experiments import AnalysisKind, Experiment
from motord.experiments.analysis import Analysis, json_of
from motord.experiments.subject import Recordings
from motord.recording.metadata import describe
from motord.recording.writer import RunWriter
from motord.schema import TICK_DTYPE

NAME = "probe"
TICKS = 20


@dataclass(frozen=True)
class ProbedTorque:
    """The mean torque of a recording."""

    torque_Nm: float


def estimate(recordings: Recordings, factor: float = 1.0) -> ProbedTorque:
    [run] = recordings.runs
    match run.path.name.rstrip("0123456789.mcap"):
        case "kills":
            os.kill(os.getpid(), signal.SIGKILL)
        case "raises":
            os.write(1, b"no line of JSON\n")
            os.write(2, b"not for the terminal\n")
            raise ZeroDivisionError("two\nlines")
        case "exits":
            raise SystemExit(7)
        case "waits":
            (run.path.parent / "gate").read_text()
    return ProbedTorque(factor * float(run.ticks(("torque_Nm",))["torque_Nm"].mean()))


ANALYSIS = Analysis(
    estimate,
    json=json_of("motord.probe/1", "name"),
    report=lambda *_: None,
    text=lambda result, _: [f"torque {result.torque_Nm:g} Nm"],
)
EXPERIMENT = Experiment(
    analyses=(AnalysisKind(NAME, "Mean torque.", f"{__name__}:ANALYSIS"),), position=1000
)


def write(path: Path, torque_Nm: float = 1.0) -> Path:
    """Write a recording of a few ticks with this torque."""
    ticks = np.zeros(TICKS, TICK_DTYPE)
    ticks["t_ns"] = 1_700_000_000_000_000_000 + np.arange(TICKS) * 1_000_000
    ticks["tick"] = np.arange(TICKS)
    ticks["torque_Nm"] = torque_Nm
    with RunWriter(path, describe(load(), packaged("sim.toml").read_text())) as writer:
        writer.ticks(ticks)
    return path


def register(monkeypatch: pytest.MonkeyPatch) -> None:
    """Register the analysis in this process."""
    known = experiments._registered()[0]
    monkeypatch.setattr(experiments, "_registered", lambda: ((*known, EXPERIMENT), {}))


def announced(folder: Path) -> dict[str, str]:
    """Return the environment of processes that know the analysis by an entry point."""
    information = folder / "motord_probe-0.dist-info"
    information.mkdir(parents=True)
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: motord_probe\nVersion: 0\n")
    entry = f"[{experiments.GROUP}]\n{NAME} = {__name__}:EXPERIMENT\n"
    (information / "entry_points.txt").write_text(entry)
    path = os.pathsep.join(
        [str(folder), str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
    )
    return {**os.environ, "PYTHONPATH": path}
