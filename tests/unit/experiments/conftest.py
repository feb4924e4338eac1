from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from motord.calibration import Calibration
from motord.config import load, packaged
from motord.experiments.plans import build
from motord.identification.disturbances import lines_of_points
from motord.recording.metadata import describe
from motord.recording.writer import RunWriter
from motord.virtual import VirtualBench
from motord.virtual.plan import run_plan

MESH = {"torques_Nm": [2.0, 4.0], "speeds_Hz": [0.8, 1.0], "turns": 5, "settle_s": 1.0}


@dataclass(frozen=True)
class Recorded:
    """Recordings of a small mesh on the simulated bench, without and with compensation."""

    off: Path
    on: Path
    calibration: Path


def record(bench: VirtualBench, path: Path, compensate: str, **mesh: object) -> None:
    plan = build("verify", bench.config, {**MESH, **mesh, "compensate": compensate})
    metadata = describe(bench.config, packaged("sim.toml").read_text())
    with RunWriter(path, metadata) as writer:

        def on_block(ticks: np.ndarray, truth: np.ndarray) -> None:
            writer.ticks(ticks)
            writer.truth(truth)

        for point in run_plan(bench, plan, on_block):
            writer.operating_point(int(point["t_end_ns"]), point)


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    from datetime import UTC, datetime

    from motord.experiments.calibration.estimate.calibrator import Calibrator
    from motord.experiments.subject import Subject
    from motord.recording.reader import open_run

    folder = tmp_path_factory.mktemp("runs")
    files = Recorded(folder / "off.mcap", folder / "on.mcap", folder / "calibration.json")
    bench = VirtualBench(load(), seed=5)
    record(bench, files.off, "off")
    subject = Subject.of_config(bench.config)
    result = Calibrator.of_runs([open_run(files.off)], subject).joint()
    calibration: Calibration = result.to_calibration(
        subject.motor, datetime.now(UTC), [files.off.name]
    )
    calibration.save(files.calibration)
    bench.install(calibration)
    record(bench, files.on, "on")
    return files


@pytest.fixture
def no_search_for_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spare the time of looking for lines that are not locked to the rotor: there are none."""
    monkeypatch.setattr(lines_of_points, "asynchronous_lines", lambda *_: ())
