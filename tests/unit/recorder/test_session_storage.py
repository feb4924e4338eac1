"""A session whose disk is full, stalls, fails, or loses its folder."""

import errno
import shutil
import threading
from pathlib import Path

import numpy as np
import pytest

from motord.config import RecordingConfig
from motord.recorder.rolling_file import RollingFile
from motord.recording import storage
from motord.recording.errors import RecordError
from motord.recording.file_names import file_name
from motord.recording.reader import open_run
from motord.recording.storage import free_bytes, obstacle
from motord.schema import TICK_DTYPE
from motord.shm.ring import RingWriter
from tests.unit.recorder.recorder_bench import CAPACITY, PLENTY, Bench, FreeSpace

pytestmark = pytest.mark.usefixtures("free_space")


def test_too_little_space_ends_the_recording_cleanly(bench):
    bench.start()
    bench.loop(100)
    bench.step(1.1)
    FreeSpace.bytes = 999_999
    bench.loop(50)
    bench.step(0.05)
    assert bench.report()["recording"]
    bench.step(1.0)
    report = bench.report()
    assert not report["recording"]
    assert "less than recording.free_min_MB = 1 is free; the recording was ended" in report["error"]
    run = open_run(bench.files()[0])
    assert bench.files()[0].suffix == ".mcap"
    assert run.damage is None
    assert run.events()[-1]["kind"] == "recording_ended"
    assert bench.recorded() == list(range(150))
    bench.loop(50)
    bench.step()
    bench.do(do="event", t_ns=1, content={"kind": "late", "message": "late"})
    assert bench.recorded() == list(range(150))
    bench.start()
    assert "nothing is recorded" in bench.report()["error"]
    FreeSpace.bytes = PLENTY
    bench.start()
    assert bench.report()["error"] == ""
    bench.stop()


def test_a_disk_that_fails_ends_the_recording(bench, monkeypatch):
    bench.start()
    bench.loop(100)
    bench.step(1.1)

    def fail(descriptor: int, data: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.write", fail)
    bench.loop(50)
    bench.step(1.1)
    report = bench.report()
    assert not report["recording"]
    assert "No space left on device" in report["error"]
    monkeypatch.undo()
    bench.stop()
    assert bench.recorded() == list(range(100))
    assert bench.files()[0].suffix == ".part"


def test_unknown_free_space_is_no_reason_to_stop(tmp_path, monkeypatch):
    def fail(folder: Path) -> int:
        raise OSError

    monkeypatch.setattr(storage, "free_bytes", fail)
    recording = RollingFile(tmp_path / "day", {}, RecordingConfig(), 0.0)
    recording.step(5.0)
    assert recording.open
    recording.close("done")
    recording.close("done again")
    assert not recording.open


def test_free_space_of_a_folder(tmp_path):
    assert free_bytes(tmp_path) > 0


def test_a_folder_that_cannot_be_made_is_reported(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError, match="cannot make it"):
        RollingFile(tmp_path / "file" / "day" / "x", {}, RecordingConfig(), 0.0)


def refuse(stem: Path) -> Path:
    raise PermissionError(13, "Permission denied", str(stem))


@pytest.mark.parametrize(
    ("next_file", "why"),
    [(lambda stem: file_name(stem, 0), "day-000.mcap: exists already"), (refuse, "Permission")],
)
def test_a_next_file_that_cannot_be_made_leaves_the_last_one_whole(
    tmp_path, monkeypatch, next_file, why
):
    bench = Bench(tmp_path, file_max_s=0.05)
    bench.start()
    bench.loop(100)
    bench.step()
    monkeypatch.setattr("motord.recorder.rolling_file.next_file", next_file)
    bench.loop(100)
    bench.step()
    assert why in bench.report()["error"]
    assert bench.report()["path"] == str(bench.files()[0])
    assert not bench.report()["recording"]
    assert bench.recorded() == list(range(100))
    assert open_run(bench.files()[0]).damage is None


class StallingDisk:
    """Stands for os.fsync of a disk that does not answer until it is released."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.reached, self.answer = threading.Event(), threading.Event()
        monkeypatch.setattr("os.fsync", self.fsync)

    def fsync(self, descriptor: int) -> None:
        self.reached.set()
        assert self.answer.wait(60)


def stall(bench: Bench, disk: StallingDisk) -> None:
    """Get the session's thread into the disk."""
    bench.loop(10)
    bench.now_s += 1.1
    bench.session.step(bench.now_s)
    assert disk.reached.wait(60)


def loop_and_step(bench: Bench, times: int) -> None:
    for _ in range(times):
        bench.loop(CAPACITY // 2)
        bench.now_s += 0.05
        bench.session.step(bench.now_s)


def test_the_ring_is_read_while_the_disk_stalls(bench, monkeypatch):
    bench.start()
    disk = StallingDisk(monkeypatch)
    stall(bench, disk)
    loop_and_step(bench, 10)
    bench.do(do="event", t_ns=7, content={"kind": "state", "message": "meanwhile"})
    loop_and_step(bench, 10)
    assert bench.report()["ticks"] == 10
    assert bench.report()["error"] == ""
    disk.answer.set()
    bench.stop()
    assert bench.recorded() == list(range(10 + 20 * (CAPACITY // 2)))
    assert bench.report()["lost"] == 0
    assert [e["message"] for e in bench.events()] == ["meanwhile"]


def test_what_is_held_for_a_stalled_disk_is_bounded_and_the_rest_counted(tmp_path, monkeypatch):
    most = 3 * (CAPACITY // 2)
    monkeypatch.setattr("motord.recorder.session.BACKLOG_BYTES", most * TICK_DTYPE.itemsize)
    bench = Bench(tmp_path)
    bench.start()
    disk = StallingDisk(monkeypatch)
    stall(bench, disk)
    loop_and_step(bench, 20)
    disk.answer.set()
    bench.stop()
    recorded = bench.recorded()
    assert recorded[: 10 + most - CAPACITY // 2] == list(range(10 + most - CAPACITY // 2))
    missing = sorted(set(range(bench.published)) - set(recorded))
    assert recorded == sorted(set(recorded))
    assert bench.report()["lost"] == len(missing) > 10 * CAPACITY // 2
    assert [e["data"]["lost"] for e in bench.events()] == [len(missing)]


def test_a_disk_that_fails_after_a_stall_ends_the_recording(bench, monkeypatch):
    bench.start()
    disk = StallingDisk(monkeypatch)
    stall(bench, disk)

    def fail(descriptor: int, data: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.write", fail)
    loop_and_step(bench, 4)
    disk.answer.set()
    bench.session.settle()
    bench.step(1.1)
    assert "No space left on device" in bench.report()["error"]
    assert not bench.report()["recording"]
    bench.step()
    assert bench.session.over
    monkeypatch.undo()
    assert bench.recorded() == list(range(10))


def test_a_mistake_in_the_background_is_not_kept_quiet(bench, monkeypatch):
    def stumble(self: RollingFile, block: np.ndarray, lost: int) -> None:
        raise ValueError("a mistake")

    bench.start()
    bench.loop(5)
    monkeypatch.setattr(RollingFile, "ticks", stumble)
    with pytest.raises(RuntimeError, match="in the background failed"):
        bench.step()


def test_a_folder_that_is_deleted_is_reported_and_recording_goes_on_when_it_is_back(bench):
    bench.start()
    bench.loop(40)
    bench.step()
    bench.step(1.0)  # a sync
    shutil.rmtree(bench.stem.parent)
    bench.stem.parent.write_text("in the way of a folder")
    bench.loop(10)
    bench.step(1.1)
    bench.step()
    report = bench.report()
    assert not report["recording"]
    assert "it was removed or moved while it was being written" in report["error"]
    for _ in range(10):
        bench.loop(10)
        bench.step(1.0)
    assert not bench.report()["recording"]
    assert bench.report()["error"] != ""
    bench.stem.parent.unlink()
    bench.step(30.0)
    bench.step(30.0)
    bench.loop(10)
    bench.step()
    report = bench.report()
    assert report["recording"]
    assert report["error"] == ""
    assert Path(report["path"]).exists()
    bench.stop()
    recorded = bench.recorded()
    assert recorded == list(range(160))  # the ring had them all
    [event] = [e for e in bench.events() if e["kind"] == "recording_resumed"]
    assert event["data"]["lost"] == 0
    assert "removed or moved" in event["data"]["reason"]


def test_what_a_vanished_file_had_and_the_ring_has_no_more_is_counted(bench):
    bench.start()
    bench.loop(40)
    bench.step(1.1)
    shutil.rmtree(bench.stem.parent)
    bench.step(1.1)
    bench.loop(CAPACITY)
    bench.step(30.0)
    bench.loop(10)
    bench.step(0.05)
    bench.stop()
    recorded = bench.recorded()
    assert recorded == list(range(recorded[0], 40 + CAPACITY + 10))
    assert bench.report()["lost"] == recorded[0]
    assert recorded[0] > 40


def test_a_disk_that_was_full_takes_the_rest_in_a_new_file(bench):
    bench.start()
    for _ in range(4):
        bench.loop(30)
        bench.step(1.1)
    FreeSpace.bytes = 0
    bench.loop(10)
    bench.step(1.1)
    bench.step(1.1)
    assert "free_min_MB" in bench.report()["error"]
    bench.loop(50)
    bench.step(1.1)
    FreeSpace.bytes = PLENTY
    bench.step(30.0)
    bench.loop(5)
    bench.step()
    bench.stop()
    assert bench.recorded() == list(range(185))
    assert [f.name for f in bench.files()] == ["day-000.mcap", "day-001.mcap"]


def test_a_start_that_fails_is_tried_again_and_loses_nothing(bench):
    bench.loop(20)
    bench.stem.parent.write_text("in the way of a folder")
    bench.start()
    assert bench.report()["error"] != ""
    bench.loop(30)
    bench.step()
    bench.stem.parent.unlink()
    bench.step(1.1)
    bench.step()
    bench.stop()
    assert bench.recorded() == list(range(20, 50))
    assert bench.report()["error"] == ""


def test_a_file_that_cannot_get_its_name_at_the_end_is_reported(bench):
    bench.start()
    bench.loop(40)
    bench.step()
    shutil.rmtree(bench.stem.parent)
    bench.stop()
    [outcome] = bench.report()["leftovers"].values()
    assert "not ended in order, with 40 ticks" in outcome


def test_a_descriptor_that_is_missing_is_an_error_and_not_the_end(bench, monkeypatch):
    def no_more(*arguments):
        raise OSError(errno.EMFILE, "Too many open files")

    with monkeypatch.context() as patch:
        patch.setattr("motord.recorder.session.last_mark", no_more)
        bench.start(resume=True)
    assert "Too many open files" in bench.report()["error"]


def test_whether_it_could_record_is_looked_at_while_it_does_not(bench):
    bench.settings = bench.session._settings.model_copy(update={"directory": bench.stem.parent})
    bench.session = bench.new_session()
    bench.step()
    assert "obstacle" not in bench.report()
    assert bench.files() == []
    FreeSpace.bytes = 0
    bench.step(2.1)
    assert "free_min_MB" in bench.report()["obstacle"]
    FreeSpace.bytes = PLENTY
    shutil.rmtree(bench.stem.parent)
    bench.stem.parent.write_text("in the way of a folder")
    bench.step(2.1)
    assert f"{bench.stem.parent}: cannot write there" in bench.report()["obstacle"]
    bench.stem.parent.unlink()
    bench.step(2.1)
    assert "obstacle" not in bench.report()


def test_a_folder_that_is_there_but_takes_no_file_is_an_obstacle(tmp_path, monkeypatch):
    settings = RecordingConfig(directory=tmp_path, free_min_MB=0.0)
    assert obstacle(settings) == ""

    def immutable(path, content):
        raise PermissionError(errno.EPERM, "Operation not permitted", str(path))

    monkeypatch.setattr(Path, "write_bytes", immutable)
    assert obstacle(settings) == f"{tmp_path}: cannot write there: Operation not permitted"


def _without_its_folder(bench: Bench, count: int) -> None:
    """Have the disk end a recording whose ring has `count` ticks, and let it go on."""
    bench.loop(count)
    bench.step()
    shutil.rmtree(bench.stem.parent)
    bench.step(1.1)


def test_what_a_removed_ring_still_gives_is_recorded_again_after_a_failure(bench):
    bench.start()
    _without_its_folder(bench, 40)
    bench.ring_path.unlink()
    bench.loop(10)
    bench.step(30.0)
    bench.step()
    bench.stop()
    assert bench.recorded() == list(range(50))


def test_the_last_ticks_of_a_loop_are_recorded_before_its_successors_after_a_failure(bench):
    bench.start()
    _without_its_folder(bench, 40)
    bench.loop(10)
    bench.ring.close()
    bench.ring = RingWriter(bench.ring_path, CAPACITY)
    bench.loop(5, first=0)
    for seconds in (30.0, 0.05, 0.05):
        bench.step(seconds)
    bench.stop()
    assert bench.recorded() == [*range(50), *range(5)]


def test_a_recorder_that_follows_no_other_loop_does_not_after_a_failure_either(bench):
    """That one is recorded by its own daemon's recorder."""
    bench.start()
    bench.session.stop_following()
    _without_its_folder(bench, 40)
    bench.ring.close()
    bench.ring = RingWriter(bench.ring_path, CAPACITY)
    bench.loop(5, first=0)
    for seconds in (30.0, 0.05, 0.05):
        bench.step(seconds)
    assert bench.session.over
    bench.stop()
    assert bench.recorded() == list(range(40))
