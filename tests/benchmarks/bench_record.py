"""What recording costs: ticks written and read, beside the `mcap` library on the same ticks.

    python -m tests.benchmarks.bench_record [--json FILE] [--ticks N] [--rate-Hz R]

Both write the same messages, zstd, chunks of a quarter of a second. motord writes from blocks of
50 ms, as the recorder gets them from the ring, and has the disk confirm the file, which the library
does not. The library is timed with messages that are encoded already ("messages"), with
google.protobuf encoding and decoding them ("fields"), and with the fields put into arrays
("arrays"), which is what motord reads. The ways alternate in rounds, so that a disturbance of the
machine hits all of them; a figure is the median.
"""

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import SeekingReader
from mcap.writer import CompressionType, Writer

from motord.record.reader import open_run
from motord.record.rows import HEAD
from motord.record.writer import RunWriter
from motord.schema import TICK, TICK_DTYPE
from motord.wire.blocks import BlockCodec

ROUNDS = 5
CHUNK_S = 0.25
BLOCK_S = 0.05
WRITE_RATIO_WANTED = 5.0
READ_RATIO_WANTED = 20.0
COLUMNS = ("t_ns", "encoder_count", "torque_Nm", "i_a_A", "i_b_A", "i_c_A", "plan_point")


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
    for file in descriptor_pb2.FileDescriptorSet.FromString(BlockCodec(TICK).descriptor_set()).file:
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
        self.chunk_size = round(CHUNK_S * rate_Hz) * (HEAD.size + self.codec.size)

    def write_motord(self) -> None:
        with RunWriter(self.ours, {}, chunk_s=CHUNK_S) as writer:
            for start in range(0, len(self.ticks), self.block):
                writer.ticks(self.ticks[start : start + self.block])

    def write_mcap_messages(self) -> None:
        self._write(lambda i: self.messages[i])

    def write_mcap_fields(self) -> None:
        self._write(lambda i: self.message(**self.rows[i]).SerializeToString())

    def read_motord(self) -> None:
        assert len(open_run(self.ours).ticks()) == len(self.ticks)

    def read_motord_7_columns(self) -> None:
        assert len(open_run(self.ours).ticks(COLUMNS)) == len(self.ticks)

    def read_mcap_messages(self) -> None:
        with self.ours.open("rb") as file:
            messages = SeekingReader(file).iter_messages("/tick", log_time_order=False)
            assert sum(1 for _ in messages) == len(self.ticks)

    def read_mcap_fields(self) -> None:
        with self.ours.open("rb") as file:
            for _, _, message in SeekingReader(file).iter_messages("/tick", log_time_order=False):
                self.message.FromString(message.data)

    def read_mcap_arrays(self) -> None:
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

    def _write(self, encoded: Callable[[int], bytes]) -> None:
        with self.theirs.open("wb") as file:
            options = {"chunk_size": self.chunk_size, "compression": CompressionType.ZSTD}
            writer = Writer(file, **options)
            writer.start()
            descriptor = self.codec.descriptor_set()
            schema = writer.register_schema("motord.Tick", "protobuf", descriptor)
            channel = writer.register_channel("/tick", "protobuf", schema)
            for i, t_ns in enumerate(self.times_ns):
                writer.add_message(channel, t_ns, encoded(i), t_ns, i)
            writer.finish()


def measure(count: int, rate_Hz: int) -> dict[str, Any]:
    """Return all results: microseconds a tick, and ratios."""
    with tempfile.TemporaryDirectory() as name:
        ways = Ways(tick_block(count, rate_Hz), rate_Hz, Path(name))
        parts = {
            "write, motord": ways.write_motord,
            "write, mcap, messages": ways.write_mcap_messages,
            "write, mcap, fields": ways.write_mcap_fields,
            "read, motord, all columns": ways.read_motord,
            "read, motord, 7 columns": ways.read_motord_7_columns,
            "read, mcap, messages": ways.read_mcap_messages,
            "read, mcap, fields": ways.read_mcap_fields,
            "read, mcap, arrays": ways.read_mcap_arrays,
        }
        rounds: dict[str, list[float]] = {part: [] for part in parts}
        for _ in range(ROUNDS):
            for part, action in parts.items():
                if action == ways.write_motord:
                    ways.ours.unlink(missing_ok=True)
                begun_s = time.perf_counter()
                action()
                rounds[part].append((time.perf_counter() - begun_s) / count * 1e6)
        size = ways.ours.stat().st_size / count
    us = {part: statistics.median(times) for part, times in rounds.items()}
    write, read = us["write, motord"], us["read, motord, all columns"]
    return {
        "ticks": count,
        "rate_Hz": rate_Hz,
        "us_a_tick": us,
        "bytes_a_tick": size,
        "ratios": {
            "write, to mcap messages": us["write, mcap, messages"] / write,
            "write, to mcap fields": us["write, mcap, fields"] / write,
            "read, to mcap messages": us["read, mcap, messages"] / read,
            "read, to mcap fields": us["read, mcap, fields"] / read,
            "read, to mcap arrays": us["read, mcap, arrays"] / read,
        },
        "wanted": {"write": WRITE_RATIO_WANTED, "read": READ_RATIO_WANTED},
    }


def print_table(results: dict[str, Any]) -> None:
    """Print the results for people."""
    lines = [f"{results['ticks']} ticks at {results['rate_Hz']} Hz: a tick, median"]
    lines += [f"  {name:28} {us:8.2f} us" for name, us in results["us_a_tick"].items()]
    lines += [f"  {'size':28} {results['bytes_a_tick']:8.0f} bytes", "times as fast as the library"]
    lines += [f"  {name:28} {ratio:8.1f}" for name, ratio in results["ratios"].items()]
    sys.stdout.write("\n".join(lines) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--json", type=Path, help="write the results to this file")
    parser.add_argument("--ticks", type=int, default=100_000)
    parser.add_argument("--rate-Hz", type=int, default=10_000)
    options = parser.parse_args()
    results = measure(options.ticks, options.rate_Hz)
    print_table(results)
    if options.json:
        options.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
