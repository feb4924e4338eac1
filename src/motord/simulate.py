"""A plan on the simulated rig in virtual time, recorded as the daemon would record it."""

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import pairwise
from operator import itemgetter
from pathlib import Path

import numpy as np

from motord.calibration import Calibration
from motord.config import Config, load, packaged
from motord.intervals import two_digits
from motord.recording.file_names import part_of, require_free
from motord.recording.metadata import describe
from motord.recording.storage import free_bytes
from motord.recording.writer import RunWriter
from motord.sequencing import Plan
from motord.sequencing.quality import GOOD
from motord.untrusted import read_text
from motord.virtual.bench import rig_and_faults
from motord.virtual.mesh import ROW_BYTES, MeshPiece, run_points
from motord.virtual.plan import PlanFailed, channel_readings
from motord.virtual.preflight import BY_HAND

CHUNK_S = 1.0
"""Time that one chunk of a recording spans; nothing here dies, so chunks may be large."""

COMPRESSED = 0.6
"""What a recording takes of the bytes of its ticks and truth; 0.8 if little of it is at rest."""

Progress = Callable[[float], None]
"""Called with the fraction that is done."""


@dataclass(frozen=True)
class PlanSource:
    """A bench, and the text of the file that it was read from."""

    config: Config
    text: str

    @classmethod
    def of(cls, path: Path | None = None) -> "PlanSource":
        """Return the bench of a file, or the packaged simulated bench. Raises ConfigError."""
        return cls(load(path), read_text(path or packaged("sim.toml")))


@dataclass(frozen=True)
class Recorded:
    """Time on the bench (s), the number of operating points, and of those that are poor."""

    bench_s: float
    points: int
    poor: int


def recorded_bytes(config: Config, plan: Plan) -> float:
    """Return about how many bytes the recording of a simulated plan takes."""
    return plan.seconds * config.loop.rate_Hz * ROW_BYTES * COMPRESSED


def require_room(config: Config, plan: Plan, folder: Path) -> None:
    """Raise PlanFailed if the recording does not fit in `folder`."""
    needed = recorded_bytes(config, plan)
    with suppress(OSError):  # whether it can be written at all is found when it is
        free = free_bytes(folder)
        if needed > free:
            raise PlanFailed(
                f"{plan.name}: about {two_digits(plan.seconds / 3600)} h on the bench, and its "
                f"recording about {two_digits(needed / 1e9)} GB; {folder} has "
                f"{two_digits(free / 1e9)} GB: shorten it, or name a file where there is more"
            )


def record_plan(
    source: PlanSource,
    plan: Plan,
    path: Path,
    seed: int,
    calibration: Calibration | None = None,
    pool: ProcessPoolExecutor | None = None,
    progress: Progress = lambda fraction: None,
) -> Recorded:
    """Run `plan` and write ticks, truth, points and metadata to `path`.

    Each operating point is taken on a rig of its own, on all processors if there is a `pool`; but
    those of a continuous plan. Of one that is interrupted or fails there is no file.
    Raises PlanFailed, ConfigError where rig or faults do not fit the bench, RecordError, OSError.
    """
    config = source.config
    metadata = describe(
        config,
        source.text,
        plan={"name": plan.name, "settings": plan.settings},
        calibration_id=calibration.id if calibration else "",
    )
    rig, _ = rig_and_faults(config)  # what is wrong is found before a file is begun
    if plan.name in BY_HAND and rig.swing is None:
        raise PlanFailed(
            f"{plan.name}: the simulated rig has no bar on springs that somebody lets go ([swing] "
            f"of its rig file); simulate the packaged one: -c {packaged('inertia.toml')}"
        )
    ticks = number = poor = 0
    progress(0.0)
    with _whole_or_nothing(path), RunWriter(path, metadata, chunk_s=CHUNK_S) as writer:
        for number, piece in enumerate(run_points(config, plan, seed, calibration, pool), start=1):
            _write(writer, piece, config)
            ticks += piece.ticks.size
            poor += piece.point["quality"] != GOOD
            progress(number / len(plan.points))
    progress(1.0)
    return Recorded(ticks / config.loop.rate_Hz, number, poor)


@contextmanager
def _whole_or_nothing(path: Path) -> Iterator[None]:
    require_free(path, part_of(path))
    try:
        yield
    except BaseException:  # an interrupt, too
        part_of(path).unlink(missing_ok=True)
        raise


def _write(writer: RunWriter, piece: MeshPiece, config: Config) -> None:
    """Write a piece chunk by chunk, ticks and truth of each together: no chunk is cut in two."""
    readings = deque(sorted(channel_readings(config.channels, piece.truth), key=itemgetter(0)))
    chunk = piece.ticks["t_ns"] // round(CHUNK_S * 1e9)
    edges = np.flatnonzero(np.diff(chunk)) + 1
    for first, end in pairwise([0, *edges.tolist(), piece.ticks.size]):
        ticks = piece.ticks[first:end]
        writer.ticks(ticks)
        writer.truth(piece.truth[first:end])
        while readings and readings[0][0] <= int(ticks["t_ns"][-1]):
            t_ns, channel, value = readings.popleft()
            content = {"value": value, "raw": value, "status": "ok"}
            writer.channel(t_ns, channel.name, channel.unit, channel.timeout_s, content)
    writer.operating_point(int(piece.point["t_end_ns"]), piece.point)
