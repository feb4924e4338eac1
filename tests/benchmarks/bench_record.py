"""What recording costs: ticks written and read, against the `mcap` library on the same ticks.

motord writes from blocks of 50 ms, as its recorder gets them from the ring, and waits until the
disk has the file, which the library does not. Each writes as it does by default: zstd with
checksums, motord in chunks of a quarter of a second, the library in chunks of 1 MiB. Both read the
same file. motord checks the checksums and gives arrays of all columns. The library is timed in ways
that do less and more of that:

- write, "encoded": it is given messages that are encoded already; "fields": google.protobuf encodes
  them first
- read, "messages": it gives the messages as they are, not decoded, in the order of the file, and
  does not look at checksums; "checked": it does; "decoded": google.protobuf decodes them; "arrays":
  their fields are put into arrays, which is what motord gives; "records": beneath its reader, all
  records as they come

The bounds are for the first of each, the least that the library's writer and reader do. The ways
alternate in rounds, so that a disturbance of the machine hits all of them. Ratios are of elapsed
time, medians over the rounds; the notes give those of processor time too. motord reads the file
several times in a round, so that its turns are not much shorter than those of the library.
"""

import gc
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import SeekingReader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.schema import TICK, TICK_DTYPE
from motord.wire.ticks.blocks import BlockCodec
from motord.wire.ticks.proto_text import descriptor_set
from tests.benchmarks.figure import Figure
from tests.system.recorded import cpu_s, recorded_loop

RATES_Hz = (10_000, 1000)
TICKS, QUICK_TICKS = 100_000, 20_000
ROUNDS, QUICK_ROUNDS = 9, 3
READS = 10
BLOCK_S = 0.05
WRITE_RATIO_WANTED = 5.0
READ_RATIO_WANTED = 20.0
RECORDER_S, QUICK_RECORDER_S = 30.0, 4.0
SHARE_LIMIT_percent = 20.0
COLUMNS = ("t_ns", "encoder_count", "torque_Nm", "i_a_A", "i_b_A", "i_c_A", "plan_point")

WRITE, READ = "write, motord", "read, motord, all columns"
WRITE_HARDEST, READ_HARDEST = "write, mcap, encoded", "read, mcap, messages"


def tick_block(count: int, rate_Hz: int) -> np.ndarray:
    """Ticks of a turning motor, with noise where a bench has noise."""
    rng, n = np.random.default_rng(1), np.arange(count)
    block = np.zeros(count, TICK_DTYPE)
    angle_rad = n / rate_Hz * 2 * np.pi * 0.7
    for name in (name for name in TICK_DTYPE.names if TICK_DTYPE[name].kind == "f"):
        block[name] = np.sin(8 * angle_rad + len(name)) + 0.01 * rng.standard_normal(count)
    for name in ("trip_bits", "first_trip", "link_errors", "drive_set_rad_s", "brake_set"):
        block[name] = 0
    block["tick"] = n
    block["t_ns"] = 1_700_000_000_000_000_000 + n * (1_000_000_000 // rate_Hz)
    block["encoder_count"] = (angle_rad / (2 * np.pi) * 4096).astype(int) % 4096
    block["encoder_gray"] = block["encoder_count"] ^ (block["encoder_count"] >> 1)
    block["wake_late_ns"] = rng.integers(100, 20_000, count)
    block["work_ns"] = rng.integers(20_000, 40_000, count)
    return block


def tick_message() -> type[Any]:
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(descriptor_set(TICK)).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("motord.Tick"))


class Ways:
    """Each way of writing and of reading the same ticks."""

    def __init__(self, ticks: np.ndarray, rate_Hz: int, folder: Path) -> None:
        self.ticks = ticks
        self.block = max(1, round(BLOCK_S * rate_Hz))
        self.ours, self.theirs = folder / "ours.mcap", folder / "theirs.mcap"
        self.codec = BlockCodec(TICK)
        self.messages = [row.tobytes() for row in self.codec.encode(ticks)]
        self.times_ns = ticks["t_ns"].tolist()
        self.rows = [dict(zip(TICK_DTYPE.names, row.item(), strict=True)) for row in ticks]
        self.message = tick_message()

    def all(self) -> dict[str, Callable[[], None]]:
        return {
            WRITE: self.write_motord,
            WRITE_HARDEST: lambda: self._write(lambda i: self.messages[i]),
            "write, mcap, fields": lambda: self._write(
                lambda i: self.message(**self.rows[i]).SerializeToString()
            ),
            READ: lambda: self._read(None),
            READ_HARDEST: lambda: self._read_messages(checked=False),
            "read, mcap, records": self.read_records,
            "read, mcap, checked": lambda: self._read_messages(checked=True),
            "read, mcap, decoded": self.read_decoded,
            "read, mcap, arrays": self.read_arrays,
            "read, motord, 7 columns": lambda: self._read(COLUMNS),
        }

    def write_motord(self) -> None:
        with RunWriter(self.ours, {}) as writer:
            for start in range(0, len(self.ticks), self.block):
                writer.ticks(self.ticks[start : start + self.block])

    def read_records(self) -> None:
        with self.ours.open("rb") as file:
            records = StreamReader(file).records
            assert sum(isinstance(record, Message) for record in records) == len(self.ticks)

    def read_decoded(self) -> None:
        with self.ours.open("rb") as file:
            for _, _, message in SeekingReader(file).iter_messages("/tick", log_time_order=False):
                self.message.FromString(message.data)

    def read_arrays(self) -> None:
        columns: dict[str, list[float]] = {name: [] for name in TICK_DTYPE.names}
        adders = [(name, column.append) for name, column in columns.items()]
        with self.ours.open("rb") as file:
            for _, _, message in SeekingReader(file).iter_messages("/tick", log_time_order=False):
                tick = self.message.FromString(message.data)
                for name, add in adders:
                    add(getattr(tick, name))
        block = np.empty(len(self.ticks), TICK_DTYPE)
        for name, column in columns.items():
            block[name] = column

    def _read(self, columns: tuple[str, ...] | None) -> None:
        assert len(open_run(self.ours).ticks(columns)) == len(self.ticks)

    def _read_messages(self, *, checked: bool) -> None:
        with self.ours.open("rb") as file:
            reader = SeekingReader(file, validate_crcs=checked)
            messages = reader.iter_messages("/tick", log_time_order=False)
            assert sum(1 for _ in messages) == len(self.ticks)

    def _write(self, encoded: Callable[[int], bytes]) -> None:
        with self.theirs.open("wb") as file:
            writer = Writer(file)
            writer.start()
            descriptor = descriptor_set(TICK)
            schema = writer.register_schema("motord.Tick", "protobuf", descriptor)
            channel = writer.register_channel("/tick", "protobuf", schema)
            for i, t_ns in enumerate(self.times_ns):
                writer.add_message(channel, t_ns, encoded(i), t_ns, i)
            writer.finish()


class Costs:
    """What each way took in each round, us a tick, and what the files take, bytes a tick."""

    def __init__(self, count: int, rate_Hz: int, rounds: int) -> None:
        with tempfile.TemporaryDirectory() as name:
            ways = Ways(tick_block(count, rate_Hz), rate_Hz, Path(name))
            parts = ways.all()
            self._us: dict[str, list[float]] = {part: [] for part in parts}
            self._cpu_us: dict[str, list[float]] = {part: [] for part in parts}
            gc.collect()
            gc.freeze()  # or what is held here would cost the library, which makes many objects
            for _ in range(rounds):
                ways.ours.unlink(missing_ok=True)
                for part, action in parts.items():
                    times = READS if part.startswith("read, motord") else 1
                    begun_s, cpu_begun_s = time.perf_counter(), time.process_time()
                    for _ in range(times):
                        action()
                    us = 1e6 / (times * count)
                    self._cpu_us[part].append((time.process_time() - cpu_begun_s) * us)
                    self._us[part].append((time.perf_counter() - begun_s) * us)
            gc.unfreeze()
            self.bytes_ours = ways.ours.stat().st_size / count
            self.bytes_theirs = ways.theirs.stat().st_size / count

    def us(self, part: str) -> float:
        return statistics.median(self._us[part])

    def ratio(self, theirs: str, ours: str) -> float:
        """Return how many times as long `theirs` took, the median over the rounds."""
        return _ratio(self._us[theirs], self._us[ours])

    def cpu_ratio(self, theirs: str, ours: str) -> float:
        """Return how many times as much processor time `theirs` took."""
        return _ratio(self._cpu_us[theirs], self._cpu_us[ours])


def _ratio(theirs: list[float], ours: list[float]) -> float:
    return statistics.median(a / b for a, b in zip(theirs, ours, strict=True))


def figures(quick: bool) -> list[Figure]:
    """Return ratios to the library, costs, and the recorder's share of a core."""
    found = []
    for rate_Hz in RATES_Hz:
        count, rounds = (QUICK_TICKS, QUICK_ROUNDS) if quick else (TICKS, ROUNDS)
        costs = Costs(count, rate_Hz, rounds)
        found += ratios(costs, rate_Hz, bounds=rate_Hz == RATES_Hz[0])
        found += absolute(costs, rate_Hz)
    return [*found, recorder_share(QUICK_RECORDER_S if quick else RECORDER_S)]


def ratios(costs: Costs, rate_Hz: int, *, bounds: bool) -> list[Figure]:
    """Return how many times as fast as the library motord writes and reads."""
    comparisons = (
        (WRITE, WRITE_HARDEST, WRITE_RATIO_WANTED, "given encoded messages"),
        (WRITE, "write, mcap, fields", None, "given fields"),
        (READ, READ_HARDEST, READ_RATIO_WANTED, "giving messages, unchecked"),
        (READ, "read, mcap, checked", None, "giving messages, checked"),
        (READ, "read, mcap, records", None, "giving records as they come"),
        (READ, "read, mcap, decoded", None, "giving decoded messages"),
        (READ, "read, mcap, arrays", None, "its messages put into arrays"),
    )
    return [
        Figure(
            f"{ours.partition(',')[0]} {rate_Hz / 1000:g} kHz, to mcap {how}",
            costs.ratio(theirs, ours),
            "",
            bound if bounds else None,
            "at least",
            note=f"{costs.us(theirs):.2f} and {costs.us(ours):.2f} us a tick; "
            f"of processor time {costs.cpu_ratio(theirs, ours):.1f}",
        )
        for ours, theirs, bound, how in comparisons
    ]


def absolute(costs: Costs, rate_Hz: int) -> list[Figure]:
    """Return what a tick costs."""
    at = f"a tick at {rate_Hz / 1000:g} kHz:"
    return [
        Figure(f"{at} written", costs.us(WRITE), "us"),
        Figure(f"{at} read", costs.us(READ), "us"),
        Figure(f"{at} read, 7 columns", costs.us("read, motord, 7 columns"), "us"),
        Figure(
            f"{at} in the file", costs.bytes_ours, "bytes", note=f"library {costs.bytes_theirs:.0f}"
        ),
    ]


def recorder_share(seconds: float) -> Figure:
    """Return the share of a core that the recorder takes next to a loop in real time."""
    rate_Hz = RATES_Hz[0]
    with recorded_loop(rate_Hz) as running:
        running.start_recorder()
        running.go_on(1.0)
        begun_s, before_s = time.monotonic(), cpu_s(running.recorder_pid)
        running.go_on(seconds)
        used_s = cpu_s(running.recorder_pid) - before_s
        share = used_s / (time.monotonic() - begun_s)
        lost = running.report.lost
        running.end()
    return Figure(
        f"recorder at {rate_Hz / 1000:g} kHz: share of a core",
        100 * share,
        "%",
        SHARE_LIMIT_percent,
        note=f"over {seconds:g} s; {lost} ticks lost",
    )
