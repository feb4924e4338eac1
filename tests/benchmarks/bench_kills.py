"""What is in the files when the recorder is killed, and when it has been started again.

The loop runs in real time while its recorder is killed at random moments, -9, and started again,
`resume`. A killed recorder never writes to its file again, so what was in the files at a kill can
be read afterwards: all ticks in the files that were there. What is missing then is the time from
the last of them to the newest tick in the ring, looked at just after the kill.
"""

import struct
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import zstandard
from mcap.exceptions import EndOfFile
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from motord.recording.errors import RecordError
from motord.recording.file_names import file_name, numbers, part_of
from motord.recording.reader import open_run
from tests.benchmarks.figure import Figure
from tests.support.stalls import Stalls
from tests.system.recorded import recorded_loop

RATE_Hz = 10_000
KILLS, QUICK_KILLS = 100, 5
MISSING_LIMIT_S = 1.5
MEAN_S, LONGEST_S = 0.4, 2.5
"""Of the time that a recorder has, which is exponentially distributed but for the longest."""


@dataclass
class Outcome:
    """`missing_s`: at each kill; `unreadable`: files, by whom; `gone`, `double`: ticks, in all.

    `late_s`: for how long the computer kept each recorder from running until it was killed.
    """

    missing_s: list[float] = field(default_factory=list)
    late_s: list[float] = field(default_factory=list)
    unreadable: list[str] = field(default_factory=list)
    gone: int = 0
    double: int = 0
    ticks: int = 0


@dataclass(frozen=True)
class Kill:
    """A kill when the newest tick was of `t_ns` and there were the files up to `number`."""

    t_ns: int
    number: int
    late_s: float


def kill_often(rate_Hz: int, kills: int, seed: int) -> Outcome:
    """Kill the recorder so many times, and read what it wrote."""
    rng = np.random.default_rng(seed)
    with recorded_loop(rate_Hz) as running:
        running.start_recorder()
        running.go_on(1.0)
        done = []
        for _ in range(kills):
            kept = Stalls()
            running.go_on(min(float(rng.exponential(MEAN_S)), LONGEST_S))
            late_s = kept.delay_s()
            running.kill_recorder()
            done.append(Kill(running.newest_ns, numbers(running.stem)[-1], late_s))
            running.start_recorder(resume=True)
        running.go_on(1.0)
        running.end()
        return read_back(running.stem, done)


def read_back(stem: Path, kills: Iterable[Kill]) -> Outcome:
    """Return what the files of `stem` hold, and what they held when the recorder was killed."""
    outcome, blocks = Outcome(), {}
    for number in numbers(stem):
        path = file_name(stem, number)
        block = _ticks(path if path.exists() else part_of(path), outcome)
        if len(block):
            blocks[number] = block
    for kill in kills:
        last_ns = max(int(block["t_ns"][-1]) for n, block in blocks.items() if n <= kill.number)
        outcome.missing_s.append((kill.t_ns - last_ns) / 1e9)
        outcome.late_s.append(kill.late_s)
    every = np.concatenate([blocks[number] for number in sorted(blocks)])
    steps = np.diff(every["tick"].astype(np.int64))
    skipped = np.diff(every["missed"].astype(np.int64))  # by the loop, which says so
    outcome.double = int((steps <= 0).sum())
    outcome.gone = int((steps - 1 - skipped)[steps > 0].sum())
    outcome.ticks = len(every)
    return outcome


def _ticks(path: Path, outcome: Outcome) -> np.ndarray:
    """Return the ticks in a file as motord reads them; the library must find as many."""
    try:
        block = open_run(path).ticks(["tick", "t_ns", "missed"])
    except RecordError as error:
        outcome.unreadable.append(f"motord: {error}")
        return np.empty(0)
    found = library_ticks(path)
    if found != block["tick"].tolist():
        outcome.unreadable.append(f"mcap library: {path.name}: {len(found)} of {len(block)} ticks")
    return block


def library_ticks(path: Path) -> list[int]:
    """Return the sequence numbers of all ticks that the library's reader finds in a file.

    An unfinished file ends where its writer was killed, which the library reports by an exception.
    """
    found, channel = [], -1
    with path.open("rb") as file:
        try:
            for record in StreamReader(file, validate_crcs=True).records:
                if isinstance(record, Channel) and record.topic == "/tick":
                    channel = record.id
                elif isinstance(record, Message) and record.channel_id == channel:
                    found.append(record.sequence)
        except (EndOfFile, struct.error, zstandard.ZstdError):
            if path.suffix == ".mcap":
                raise
    return found


def figures(quick: bool) -> list[Figure]:
    """Return what was missing at the worst kill, and what afterwards."""
    kills = QUICK_KILLS if quick else KILLS
    outcome = kill_often(RATE_Hz, kills, seed=kills)
    at = f"recorder killed {kills} times at {RATE_Hz / 1000:g} kHz"
    missing_s = np.array(outcome.missing_s)
    return [
        Figure(
            f"{at}: most missing at a kill",
            float(missing_s.max()),
            "s",
            MISSING_LIMIT_S,
            note=f"median {np.median(missing_s):.2g} s",
        ),
        Figure(
            f"{at}: files that motord or the mcap library cannot read",
            len(outcome.unreadable),
            "",
            0,
            note="; ".join(outcome.unreadable[:2]),
        ),
        Figure(
            f"{at}: ticks missing or double after the restarts",
            outcome.gone + outcome.double,
            "",
            0,
            note=f"of {outcome.ticks}",
        ),
    ]
