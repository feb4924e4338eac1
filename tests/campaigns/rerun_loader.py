"""Recordings in Rerun: its MCAP loader finds every message and the value of every field of a tick.

    MOTORD_RERUN=/path/to/venv/bin/python python -m tests.campaigns.rerun_loader

rerun-sdk is no dependency of the project (its wheel has 170 MB): MOTORD_RERUN names the interpreter
of an environment that has it; without it, this one. Where there is none, the campaign says so.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from motord.recording.writer import RunWriter
from motord.schema import TICK, TICK_DTYPE
from tests.campaigns import seeds

READER = Path(__file__).with_name("rerun_reader.py")
START_NS = 1_700_000_000_000_000_000
COUNT = 20_000


def block(rng: np.random.Generator) -> np.ndarray:
    """Return ticks of random values, extremes, infinities and NaN among them."""
    ticks = np.zeros(COUNT, TICK_DTYPE)
    for field in TICK.fields:
        dtype = TICK_DTYPE[field.name]
        if dtype.kind == "f":
            ticks[field.name] = rng.normal(size=COUNT)
            ticks[field.name][:3] = np.nan, np.inf, -np.inf
        else:
            limits = np.iinfo(dtype)
            ticks[field.name] = rng.integers(limits.min, limits.max, COUNT, dtype, endpoint=True)
            ticks[field.name][:2] = limits.min, limits.max
    ticks["t_ns"] = START_NS + np.arange(COUNT) * 100_000
    return ticks


def write(path: Path, ticks: np.ndarray, unfinished: bool) -> Path:
    writer = RunWriter(path, {"bench": "rerun"})
    for part in np.split(ticks, 10):
        writer.ticks(part)
        writer.event(int(part["t_ns"][-1]), "state", "READY")
    writer.plan(int(ticks["t_ns"][-1]), {"plan": "calibrate"})
    if unfinished:
        writer.abandon()
        return path.with_name(path.name + ".part")
    writer.close()
    return path


def compare(python: str, path: Path, ticks: np.ndarray) -> None:
    out = path.with_suffix(".parquet")
    done = subprocess.run(
        [python, str(READER), str(path), str(out)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {"/tick": COUNT, "/event": 10, "/plan": 1}
    found = pq.read_table(out)
    assert found.num_rows == COUNT
    for field in TICK.fields:
        np.testing.assert_array_equal(
            found[field.name].to_numpy(), ticks[field.name], err_msg=field.name
        )
    np.testing.assert_array_equal(found["message_log_time"].to_numpy(), ticks["t_ns"])


def main() -> None:
    python = os.environ.get("MOTORD_RERUN", sys.executable)
    there = subprocess.run([python, "-c", "import rerun.chunk"], capture_output=True, check=False)
    if there.returncode:
        print("skipped: needs rerun-sdk >= 0.41; MOTORD_RERUN names an interpreter that has it")
        return
    rng = np.random.default_rng(seeds.first())
    with tempfile.TemporaryDirectory() as folder:
        ticks = block(rng)
        for unfinished in (False, True):
            path = write(Path(folder) / f"run-{unfinished}.mcap", ticks, unfinished)
            compare(python, path, ticks)
            print(f"{path.name}: {COUNT} ticks of {len(TICK.fields)} fields are equal in Rerun")


if __name__ == "__main__":
    main()
