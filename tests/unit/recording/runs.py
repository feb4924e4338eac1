"""Runs made up for tests."""

from pathlib import Path
from typing import Any

import numpy as np

from motord.recording.reader import Run, open_run
from motord.recording.writer import RunWriter
from motord.schema import TICK_DTYPE, TRUTH_DTYPE

START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 1_000_000
COUNT = 700
CHUNK_S = 0.1
ROWS = 100  # ticks a chunk
METADATA = {"bench": "sim", "motor": "AFPM-6", "versions": {"motord": "0"}, "notes": "[1, 2]"}


def tick_block(count: int, first: int = 0, seed: int = 1) -> np.ndarray:
    """`count` ticks of a 1 kHz loop, from tick `first` on; the other fields are noise."""
    rng = np.random.default_rng([seed, first])
    block = np.frombuffer(rng.bytes(count * TICK_DTYPE.itemsize), TICK_DTYPE).copy()
    block["tick"] = np.arange(first, first + count)
    block["t_ns"] = START_NS + block["tick"].astype(np.int64) * PERIOD_NS
    return block


def truth_block(count: int, first: int = 0) -> np.ndarray:
    """What the rig did during the ticks of `tick_block`."""
    block = np.zeros(count, TRUTH_DTYPE)
    block["t_ns"] = START_NS + np.arange(first, first + count) * PERIOD_NS
    block["angle_rad"] = np.arange(first, first + count) * 0.01
    block["torque_Nm"] = np.sin(block["angle_rad"])
    return block


def same(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two blocks have the same columns with the same bits."""
    return a.dtype == b.dtype and all(a[n].tobytes() == b[n].tobytes() for n in a.dtype.names)


def point_of(ticks: np.ndarray) -> dict[str, Any]:
    """Return the operating point that was captured with `ticks`."""
    (first, first_ns), (last, last_ns) = (ticks[at][["tick", "t_ns"]].item() for at in (0, -1))
    return {
        "index": 0, "torque_Nm": 3.0, "speed_Hz": 1.0, "tick_start": first, "tick_end": last,
        "t_start_ns": first_ns, "t_end_ns": last_ns, "quality": "ok",
    }  # fmt: skip


def write_run(path: Path, count: int = 1000, **options: Any) -> np.ndarray:
    """Write a run of `count` ticks, truth, events, a plan and a point; return the ticks."""
    ticks = tick_block(count)
    with RunWriter(path, METADATA, **options) as writer:
        write_everything(writer, ticks)
    return ticks


def write_everything(writer: RunWriter, ticks: np.ndarray) -> None:
    """Write `ticks` in blocks of 50, with one message of every other topic in between."""
    truth = truth_block(len(ticks))
    for start in range(0, len(ticks), 50):
        writer.ticks(ticks[start : start + 50])
        writer.truth(truth[start : start + 50])
        t_ns = int(ticks["t_ns"][start])
        if start == 100:
            writer.event(t_ns, "state", "ENABLED", {"tick": ticks["tick"][start], "x": np.nan})
        if start == 300:
            writer.plan(t_ns, {"plan": "calibrate", "step": 3})
        if start == 500:
            writer.operating_point(t_ns, point_of(ticks[400 : start + 1]))


def changed(path: Path, old: bytes, new: bytes) -> Run:
    """Return a run of 100 ticks in whose file the first `old` became `new`."""
    write_run(path, 100)
    path.write_bytes(path.read_bytes().replace(old, new, 1))
    return open_run(path)
