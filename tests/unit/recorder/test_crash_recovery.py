"""What a bench that was killed left behind, and what the next daemon's recorder makes of it."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from motord import config
from motord.recorder.crash_recovery import CrashRecovery
from motord.recording.errors import RecordError
from motord.recording.file_names import part_of
from motord.recording.mcap.mcap_file import try_lock
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.schema import State
from motord.shm.ring import RingWriter
from motord.shm.run_directory import LEFT_MAX, RunDir
from tests.unit.recording.runs import METADATA, tick_block

STAMP = "20250101T120000000Z"


class Killed:
    """A bench that was killed: its ring, its recordings, and then the next daemon."""

    def __init__(self, folder: Path) -> None:
        base = config.load().model_dump()
        base["recording"].update(directory=str(folder / "runs"), free_min_MB=0.0)
        self.config = config.Config.model_validate_json(
            config.Config.model_validate(base, strict=False).model_dump_json()
        )
        self.folder = folder / "runs"
        self.run_dir = RunDir(self.config.bench.name, folder / "run")
        self.outcomes: dict[str, str] = {}

    def ring(self, count: int, state: State, first: int = 0) -> None:
        self.run_dir.create()
        ring = RingWriter(self.run_dir.ring, 1024)
        for row in self.block(count, state, first):
            ring.slot()[0] = row
            ring.publish()

    def block(self, count: int, state: State, first: int = 0) -> np.ndarray:
        block = tick_block(count, first)
        block["missed"], block["state"] = 0, state
        return block

    def recording(self, count: int, *, suffix: str = "", number: int = 0, whole=False) -> Path:
        name = f"{self.config.bench.name}-{STAMP}{suffix}-{number:03d}.mcap"
        writer = RunWriter(self.folder / name, {**METADATA, "recording": "x"})
        writer.ticks(self.block(count, State.ENABLED))
        writer.close() if whole else writer.abandon()
        return self.folder / name

    def next_daemon(self) -> None:
        with self.run_dir.hold():
            self.look_after()

    def look_after(self) -> None:
        recovery = CrashRecovery(self.config, self.run_dir, lambda: {"bench": "anew"}, self._note)
        recovery._since_ns += 10**15  # whatever the clock of the file system
        recovery._parts = list(recovery._unfinished())
        recovery.run()

    def _note(self, path: Path, outcome: str) -> None:
        self.outcomes[path.name] = outcome

    def recorded(self) -> list[int]:
        files = sorted(self.folder.glob("*.mcap*"))
        return [int(t) for file in files for t in open_run(file).ticks(["tick"])["tick"]]

    def names(self) -> list[str]:
        return sorted(path.name.replace(STAMP, "T") for path in self.folder.iterdir())


@pytest.fixture
def killed(tmp_path):
    return Killed(tmp_path)


def test_a_recording_goes_on_in_its_next_file_with_what_the_ring_has(killed):
    part = killed.recording(300, suffix="-calibrate")
    killed.ring(500, State.ENABLED)
    killed.next_daemon()
    assert killed.recorded() == list(range(500))
    assert killed.names() == ["sim-T-calibrate-000.mcap", "sim-T-calibrate-001.mcap"]
    assert "closed as" in killed.outcomes[part_of(part).name]
    [ring] = [outcome for outcome in killed.outcomes.values() if "200 ticks" in outcome]
    assert str(killed.folder) in ring
    second = open_run(killed.folder / f"sim-{STAMP}-calibrate-001.mcap")
    assert second.metadata["motor"] == METADATA["motor"]
    [event] = second.events()
    assert (event["kind"], event["data"]["lost"]) == ("recovered", 0)
    assert killed.run_dir.left_rings() == []
    assert open_run(part).damage is None


def test_a_ring_that_does_not_reach_back_to_a_recording_is_one_of_its_own(killed):
    killed.recording(300)
    killed.ring(1500, State.ENABLED, first=400)
    killed.next_daemon()
    first = 1900 - 1023
    assert sorted(killed.recorded()) == [*range(300), *range(first, 1900)]
    assert any("-recovered-000.mcap" in name for name in killed.names())


def test_a_bench_that_was_recorded_by_nobody_is_if_it_was_powered(killed):
    killed.ring(300, State.ENABLED)
    killed.next_daemon()
    assert killed.recorded() == list(range(300))
    [name] = killed.names()
    assert "-recovered-000.mcap" in name
    assert open_run(killed.folder / name).metadata["bench"] == "anew"


def test_a_folder_that_may_not_be_read_keeps_no_recorder_from_starting(killed, monkeypatch):
    def refuse(path):
        if killed.folder in (path, path.parent):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return listed(path)

    killed.recording(300)
    listed = Path.iterdir
    monkeypatch.setattr(Path, "iterdir", refuse)
    killed.next_daemon()
    assert killed.outcomes == {}


def test_a_bench_that_was_off_is_not_recorded_and_its_ring_removed(killed):
    killed.recording(300, whole=True)
    killed.ring(500, State.OFF)
    killed.next_daemon()
    assert len(killed.names()) == 1
    assert killed.outcomes == {}
    assert killed.run_dir.left_rings() == []


def test_what_another_process_writes_is_left_to_it(killed, monkeypatch):
    monkeypatch.setattr("motord.recorder.crash_recovery.WRITERS_S", 0.3)
    part = part_of(killed.recording(300))
    descriptor = os.open(part, os.O_RDWR)
    assert try_lock(descriptor)
    killed.next_daemon()
    assert killed.names() == [part.name.replace(STAMP, "T")]
    assert killed.outcomes == {}
    os.close(descriptor)
    killed.next_daemon()
    assert killed.names() == ["sim-T-000.mcap"]


def test_what_this_daemon_has_begun_and_other_benches_are_none_of_its_business(killed):
    killed.recording(10)
    (killed.folder / f"simulated-{STAMP}-000.mcap.part").write_bytes(b"x")
    with killed.run_dir.hold():
        recovery = CrashRecovery(killed.config, killed.run_dir, dict, killed._note)
        assert recovery._parts == [part_of(killed.folder / f"sim-{STAMP}-000.mcap")]
        young = part_of(killed.recording(10, number=1))
        os.utime(young, (2e9, 2e9))
        recovery = CrashRecovery(killed.config, killed.run_dir, dict, killed._note)
        assert young not in recovery._parts
    assert CrashRecovery(killed.config, killed.run_dir, dict, killed._note)._parts == []


@pytest.mark.parametrize("at", ["copied", "named"])
def test_one_that_is_killed_over_it_is_followed_by_one_that_ends_it(killed, at, monkeypatch):
    part = part_of(killed.recording(300))

    class KilledError(BaseException):
        """Nothing is done after a kill."""

    step, victim = {
        "copied": ("rename", part.with_name(f"sim-{STAMP}-000.closing.mcap")),
        "named": ("unlink", part),
    }[at]
    original = getattr(Path, step)

    def fatal(self, *arguments, **named):
        if self == victim:
            raise KilledError
        return original(self, *arguments, **named)

    with monkeypatch.context() as patch:
        patch.setattr(Path, step, fatal)
        with pytest.raises(KilledError):
            killed.next_daemon()
    killed.next_daemon()
    assert killed.names() == ["sim-T-000.mcap"]
    assert killed.recorded() == list(range(300))


def test_a_name_that_is_taken_and_a_file_without_sense_are_reported_and_left(killed):
    part = part_of(killed.recording(300))
    whole = killed.recording(5, suffix="-b", whole=True)
    whole.rename(killed.folder / f"sim-{STAMP}-000.mcap")
    nonsense = killed.folder / f"sim-{STAMP}-x-000.mcap.part"
    nonsense.write_bytes(b"no recording")
    killed.next_daemon()
    assert "is there, too" in killed.outcomes[part.name]
    assert "not an MCAP file" in killed.outcomes[nonsense.name]
    assert part.exists()
    assert nonsense.exists()


def test_too_little_space_is_reported(killed):
    part = part_of(killed.recording(300))
    killed.config.recording.__dict__["free_min_MB"] = 1e12
    killed.next_daemon()
    assert "too little space" in killed.outcomes[part.name]
    assert part.exists()


def test_it_is_bounded_in_time(killed, monkeypatch):
    monkeypatch.setattr("motord.recorder.crash_recovery.LIMIT_S", 0.0)
    part = part_of(killed.recording(300))
    killed.next_daemon()
    assert killed.names() == [part.name.replace(STAMP, "T")]
    recovery = CrashRecovery(killed.config, killed.run_dir, dict, killed._note)
    with pytest.raises(RecordError, match="in the time"):
        recovery._close(part)
    assert killed.names() == [part.name.replace(STAMP, "T")]


def test_a_ring_of_another_version_is_reported_and_removed(killed):
    killed.ring(10, State.ENABLED)
    content = bytearray(killed.run_dir.ring.read_bytes())
    content[8] ^= 1
    killed.run_dir.ring.write_bytes(content)
    killed.next_daemon()
    [outcome] = killed.outcomes.values()
    assert "its ticks are lost" in outcome
    assert killed.run_dir.left_rings() == []


def test_rings_are_kept_until_somebody_looks_after_them_but_not_many(killed):
    for number in range(LEFT_MAX + 2):
        killed.ring(10 + number, State.OFF)
        with killed.run_dir.hold():  # as `motord check` does
            assert not killed.run_dir.ring.exists()
    assert len(killed.run_dir.left_rings()) == LEFT_MAX
    killed.next_daemon()
    assert not killed.run_dir.path.exists()
