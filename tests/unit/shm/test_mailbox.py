"""The set-point mailbox: whole set-points, the newest, or the last one."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.control.types import SETPOINT
from motord.shm.mailbox import MailboxReader, MailboxWriter
from motord.shm.shared_records import SharedFileError, as_bytes
from motord.unix_clock import Clock
from tests.support.properties import examples


def setpoint(value: int) -> np.ndarray:
    record = np.zeros(1, SETPOINT)
    for name in SETPOINT.names or ():
        record[name] = value
    return record


@pytest.fixture
def writer(tmp_path: Path) -> MailboxWriter:
    return MailboxWriter(tmp_path / "setpoint", Clock.measure())


@pytest.fixture
def reader(tmp_path: Path, writer: MailboxWriter) -> MailboxReader:
    return MailboxReader(tmp_path / "setpoint")


def test_nothing_before_the_first_write(reader: MailboxReader) -> None:
    mine = setpoint(7)
    assert not reader.read(mine)
    assert mine == setpoint(7)


def test_newest_setpoint_once(writer: MailboxWriter, reader: MailboxReader) -> None:
    mine = setpoint(0)
    for value in (1, 2, 3):
        writer.write(setpoint(value))
    assert reader.read(mine)
    assert mine["torque_Nm"][0] == 3
    assert not reader.read(mine)


def test_heartbeat_is_the_time_of_writing_on_the_shared_clock(
    writer: MailboxWriter, reader: MailboxReader
) -> None:
    assert reader.clock == writer.clock
    before_ns = reader.clock.now_ns()
    original = setpoint(1)
    writer.write(original)
    mine = setpoint(0)
    reader.read(mine)
    assert before_ns <= mine["heartbeat_ns"][0] <= reader.clock.now_ns()
    assert original["heartbeat_ns"][0] == 1


def test_write_in_progress_leaves_the_last_one_readable(
    writer: MailboxWriter, reader: MailboxReader, tmp_path: Path
) -> None:
    writer.write(setpoint(1))
    writer._bytes[0][:] = as_bytes(setpoint(99))  # a writer that died before raising the version
    mine = setpoint(0)
    assert reader.read(mine)
    assert mine["torque_Nm"][0] == 1


class Overtaken(MailboxReader):
    """The writer publishes `writes` times in each attempt to read, `attempts` times."""

    def follow(self, writer: MailboxWriter, writes: int, attempts: int) -> None:
        self.copied = 0

        class Copies(list[memoryview]):
            def __getitem__(inner, index: int) -> memoryview:
                if self.copied < attempts:
                    for _ in range(writes):
                        writer.write(setpoint(10 + self.copied))
                self.copied += 1
                return super().__getitem__(index)

        self._bytes = Copies(self._bytes)


@given(writes=st.integers(1, 3), attempts=st.integers(0, 6))
@settings(max_examples=examples(30), deadline=None)
def test_retries_are_bounded(
    tmp_path_factory: pytest.TempPathFactory, writes: int, attempts: int
) -> None:
    path = tmp_path_factory.mktemp("mailbox") / "setpoint"
    writer = MailboxWriter(path, Clock(0))
    reader = Overtaken(path)
    writer.write(setpoint(1))
    reader.follow(writer, writes, attempts)
    mine = setpoint(0)
    assert reader.read(mine) == (attempts < MailboxReader.RETRIES)
    assert reader.copied == min(attempts + 1, MailboxReader.RETRIES)
    if attempts < MailboxReader.RETRIES:
        assert mine["torque_Nm"][0] == (9 + attempts if attempts else 1)
    else:
        assert mine["torque_Nm"][0] == 0


READS = 1000
FAST_WRITER = """
import select, sys
from pathlib import Path
import numpy as np
from motord.control.types import SETPOINT
from motord.unix_clock import Clock
from motord.shm.mailbox import MailboxWriter
writer = MailboxWriter(Path(sys.argv[1]), Clock(0))
fields = [n for n in SETPOINT.names if n != "heartbeat_ns"]
setpoints = []
for value in range(1, 201):
    record = np.zeros(1, SETPOINT)
    for name in fields:
        record[name] = value
    setpoints.append(record)
print("ready", flush=True)
while not select.select([sys.stdin], [], [], 0)[0]:
    for record in setpoints:
        writer.write(record)
last = setpoints[-1].copy()
last["seq"] = 1000
writer.write(last)
"""


def test_reader_of_a_fast_writer_never_sees_a_torn_setpoint(tmp_path: Path) -> None:
    path = tmp_path / "setpoint"
    command = [sys.executable, "-c", FAST_WRITER, str(path)]
    fields = [n for n in SETPOINT.names or () if n not in ("heartbeat_ns", "seq")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        reader = MailboxReader(path)
        mine = np.zeros(1, SETPOINT)
        taken, heartbeat_ns = 0, 0
        while mine["seq"][0] != 1000:
            assert process.poll() in (None, 0)
            if reader.read(mine):
                taken += 1
                assert len({x for name in fields for x in mine[name].ravel().tolist()}) == 1
                assert mine["heartbeat_ns"][0] >= heartbeat_ns
                heartbeat_ns = mine["heartbeat_ns"][0]
                if taken == READS:
                    process.stdin.close()
        assert taken >= READS
    assert process.returncode == 0


def test_reader_needs_a_mailbox(tmp_path: Path) -> None:
    with pytest.raises(SharedFileError, match="cannot open"):
        MailboxReader(tmp_path / "none")
