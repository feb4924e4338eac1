"""The tick ring against a plain list, and with a fast writer in another process."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from motord.config import LoopConfig
from motord.schema import TICK_DTYPE
from motord.shm.ring import RingReader, RingWriter, capacity_for
from motord.shm.shared_records import HEADER_BYTES, SharedFileError
from tests.support.patience import PATIENCE_S
from tests.support.properties import examples


def publish(writer: RingWriter, count: int) -> None:
    for _ in range(count):
        slot = writer.slot()
        slot["tick"] = writer.head
        slot["missed"] = writer.head & 0xFFFF
        writer.publish()


def test_reader_gets_every_tick_in_order(tmp_path: Path) -> None:
    writer = RingWriter(tmp_path / "ring", 16)
    reader = RingReader(tmp_path / "ring")
    publish(writer, 10)
    first, lost = reader.read(4)
    assert (first["tick"].tolist(), lost) == ([0, 1, 2, 3], 0)
    publish(writer, 8)
    second, lost = reader.read()
    assert (second["tick"].tolist(), lost) == (list(range(4, 18)), 0)
    assert reader.read()[0].shape == (0,)


def test_block_is_a_copy(tmp_path: Path) -> None:
    writer = RingWriter(tmp_path / "ring", 4)
    reader = RingReader(tmp_path / "ring")
    publish(writer, 2)
    block, _ = reader.read()
    publish(writer, 8)
    assert block["tick"].tolist() == [0, 1]


def test_start_now_and_oldest(tmp_path: Path) -> None:
    writer = RingWriter(tmp_path / "ring", 8)
    publish(writer, 20)
    now, oldest = RingReader(tmp_path / "ring"), RingReader(tmp_path / "ring", "oldest")
    assert now.backlog == 0
    assert oldest.backlog == 7
    block, lost = oldest.read()
    assert (block["tick"].tolist(), lost) == (list(range(13, 20)), 0)


def test_closed_and_superseded(tmp_path: Path) -> None:
    writer = RingWriter(tmp_path / "ring", 8)
    reader = RingReader(tmp_path / "ring")
    publish(writer, 3)
    assert not reader.closed
    writer.close()
    assert reader.closed
    assert not reader.superseded()
    successor = RingWriter(tmp_path / "ring", 8)
    publish(successor, 1)
    assert reader.superseded()
    assert reader.read()[0]["tick"].tolist() == [0, 1, 2]
    (tmp_path / "ring").unlink()
    assert reader.superseded()


class OverwritingReader(RingReader):
    """Lets the writer publish `burst` ticks between copying and looking at the head again."""

    def __init__(self, path: Path, writer: RingWriter) -> None:
        super().__init__(path, "oldest")
        self.writer = writer
        self.burst = 0

    def _copy(self, first: int, count: int) -> np.ndarray:
        block = super()._copy(first, count)
        publish(self.writer, self.burst)
        return block


@pytest.mark.parametrize(("burst", "kept"), [(0, 15), (1, 14), (14, 1), (15, 0), (40, 0)])
def test_ticks_overwritten_while_copying_are_lost(tmp_path: Path, burst: int, kept: int) -> None:
    writer = RingWriter(tmp_path / "ring", 16)
    publish(writer, 30)
    reader = OverwritingReader(tmp_path / "ring", writer)
    reader.burst = burst
    block, lost = reader.read()
    assert block["tick"].tolist() == list(range(30 - kept, 30))
    assert lost == 15 - kept
    reader.burst = 0
    following, later_lost = reader.read()
    assert len(following) + later_lost == burst


def test_slot_being_filled_is_never_read(tmp_path: Path) -> None:
    writer = RingWriter(tmp_path / "ring", 4)
    reader = RingReader(tmp_path / "ring", "oldest")
    publish(writer, 9)
    writer.slot()["tick"] = 999
    block, lost = reader.read()
    assert (block["tick"].tolist(), lost) == ([6, 7, 8], 6)


class RingModel(RuleBasedStateMachine):
    """Two readers, one writer; the model is the list of all ticks ever published."""

    folder: Path

    @initialize(power=st.integers(1, 6))
    def make(self, power: int) -> None:
        self.capacity = 2**power
        self.writer = RingWriter(self.folder / "ring", self.capacity)
        self.readers = [OverwritingReader(self.folder / "ring", self.writer) for _ in range(2)]
        self.positions = [0, 0]

    @rule(count=st.integers(0, 100))
    def publish(self, count: int) -> None:
        publish(self.writer, count)

    @rule(
        which=st.integers(0, 1),
        limit=st.none() | st.integers(0, 80),
        burst=st.just(0) | st.integers(0, 80),
    )
    def read(self, which: int, limit: int | None, burst: int) -> None:
        reader, position = self.readers[which], self.positions[which]
        reader.burst = burst
        head = self.writer.head
        first = max(position, head - self.capacity + 1)
        end = head if limit is None else min(head, first + limit)
        kept_from = min(max(first, self.writer.head + burst - self.capacity + 1), end)
        block, lost = reader.read(limit)
        assert block["tick"].tolist() == list(range(kept_from, end))
        assert block["missed"].tolist() == [n & 0xFFFF for n in range(kept_from, end)]
        assert lost == kept_from - position
        self.positions[which] = end

    @invariant()
    def readers_know_their_backlog(self) -> None:
        for reader, position in zip(self.readers, self.positions, strict=True):
            assert reader.backlog == self.writer.head - position


def test_ring_against_model(tmp_path: Path) -> None:
    RingModel.TestCase.settings = settings(
        max_examples=examples(60), stateful_step_count=25, deadline=None
    )
    RingModel.folder = tmp_path
    RingModel.TestCase("runTest").runTest()


FAST_WRITER = """
import sys
from pathlib import Path
from motord.shm.ring import RingWriter
writer = RingWriter(Path(sys.argv[1]), 256)
print("ready", flush=True)
sys.stdin.readline()
for n in range(100_000):
    slot = writer.slot()
    slot["tick"] = n
    slot["angle_rad"] = slot["drive_set_rad_s"] = n % 65536
    writer.publish()
writer.close()
"""


def test_readers_of_a_fast_writer_see_whole_ticks_and_exact_losses(tmp_path: Path) -> None:
    command = [sys.executable, "-c", FAST_WRITER, str(tmp_path / "ring")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        reader = RingReader(tmp_path / "ring", "oldest")
        process.stdin.write(b"go\n")
        process.stdin.flush()
        expected, seen = 0, 0
        while expected < 100_000:
            assert process.poll() in (None, 0)
            block, lost = reader.read(100)
            expected += lost
            ticks = block["tick"]
            assert ticks.tolist() == list(range(expected, expected + len(block)))
            assert (block["angle_rad"] == ticks % 65536).all()
            assert (block["drive_set_rad_s"] == ticks % 65536).all()
            expected += len(block)
            seen += len(block)
        assert process.wait(PATIENCE_S) == 0
        assert reader.closed
        assert 0 < seen <= 100_000


@pytest.mark.parametrize("capacity", [0, 1, 3, 100])
def test_capacity_must_be_a_power_of_two(tmp_path: Path, capacity: int) -> None:
    with pytest.raises(ValueError, match="power of two"):
        RingWriter(tmp_path / "ring", capacity)


def test_capacity_holds_the_time_asked_for() -> None:
    assert capacity_for(LoopConfig(rate_Hz=1000, ring_s=15)) == 16384
    assert capacity_for(LoopConfig(rate_Hz=1024, ring_s=16)) == 16384
    assert capacity_for(LoopConfig(rate_Hz=1025, ring_s=16)) == 32768


def test_reader_needs_a_ring(tmp_path: Path) -> None:
    with pytest.raises(SharedFileError, match="cannot open it"):
        RingReader(tmp_path / "ring")


@pytest.mark.parametrize("kept_bytes", [HEADER_BYTES, HEADER_BYTES + 100 * TICK_DTYPE.itemsize])
def test_a_ring_that_was_cut_short_is_no_ring(tmp_path: Path, kept_bytes: int) -> None:
    RingWriter(tmp_path / "ring", 128)
    os.truncate(tmp_path / "ring", kept_bytes)
    with pytest.raises(SharedFileError, match=f"cut short: only {kept_bytes} bytes"):
        RingReader(tmp_path / "ring")
