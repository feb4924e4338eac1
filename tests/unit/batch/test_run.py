"""Ledger and store agree, whatever interrupts: every recording is analysed, no result twice."""

import errno
import json
import os
from collections import Counter
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from threading import Barrier

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.atomic_write import write_cached, write_whole
from motord.batch import file_hashes, ledger, run, task
from motord.batch.error import BatchError
from motord.batch.ledger import Ledger
from motord.batch.run import analyse_each, analyse_into_store
from motord.batch.task import BatchTask, analyse_recordings
from motord.process.one_thread import ONE_THREAD
from motord.results.folders import folder as results_folder
from motord.results.store import ResultsStore
from motord.results.stored_result import file_digest
from tests.support import probe_analysis
from tests.unit.batch.pools import InlinePool

TASK = BatchTask(probe_analysis.NAME, {}, {})


@pytest.fixture(autouse=True)
def _registered(monkeypatch):
    probe_analysis.register(monkeypatch)
    for name, one in ONE_THREAD.items():
        monkeypatch.setenv(name, one)


@pytest.fixture
def folder(tmp_path):
    return recordings(tmp_path, "a", "b", "c")


def recordings(folder, *names, first_Nm=1.0):
    for number, name in enumerate(names):
        path = probe_analysis.write(folder / f"{name}.mcap", first_Nm + number)
        os.utime(path, ns=(0, 10**18))
    return folder


def paths(folder):
    return sorted(folder.glob("*.mcap"))


def analyse(folder, one=TASK, pool=None, **again):
    """Return what became of each recording: name to state and note."""
    kept = Ledger(ResultsStore(folder / "store"))
    kept.make()
    lines = analyse_into_store(
        paths(folder), one, pool or InlinePool(), kept, lambda *_: None, **again
    )
    return {line.recording.name: (line.state, line.note) for line in lines}


def states(found):
    return Counter(state for state, _ in found.values())


def values(folder):
    table = ResultsStore(folder / "store").read().table
    rows = [row for row in table.to_pylist() if row["field"] == "torque_Nm"]
    return sorted((row["run"], row["value"]) for row in rows)


@contextmanager
def hashed(monkeypatch):
    """Yield a list, and keep in it which files are hashed, in order."""
    read = []

    def digest(path):
        read.append(path)
        return file_digest(path)

    with monkeypatch.context() as patched:
        patched.setattr(file_hashes, "file_digest", digest)
        yield read
        read.sort()


def test_what_is_done_is_not_done_again(folder, monkeypatch):
    assert analyse(folder) == dict.fromkeys(["a.mcap", "b.mcap", "c.mcap"], ("done", ""))
    assert values(folder) == [("a.mcap", 1.0), ("b.mcap", 2.0), ("c.mcap", 3.0)]
    before = {path: path.read_bytes() for path in (folder / "store").glob("*.parquet")}
    again = InlinePool()
    assert states(analyse(folder, pool=again)) == {"skipped": 3}
    assert again.calls == []
    with hashed(monkeypatch) as read:
        assert states(analyse(folder, pool=again)) == {"skipped": 3}
        assert read == []
        assert states(analyse(folder, pool=again, rehash=True)) == {"skipped": 3}
    assert [path.name for path in read] == ["a.mcap", "b.mcap", "c.mcap"]
    assert again.calls == []
    assert {path: path.read_bytes() for path in before} == before


def test_workers_start_while_new_files_are_hashed_and_not_for_nothing(folder, monkeypatch):
    """A file that is read again, but is the recording that was analysed, needs none."""
    for begun, again in ((True, {}), (False, {}), (False, {"rehash": True})):
        pool = InlinePool()
        analyse(folder, pool=pool, **again)
        assert bool(pool.begun) == begun
    os.utime(folder / "b.mcap", ns=(0, 10**18 + 1))
    with hashed(monkeypatch) as read:
        analyse(folder, pool=pool)
    assert read == [folder / "b.mcap"]
    assert not pool.begun
    recordings(folder, "d", first_Nm=4.0)
    with hashed(monkeypatch) as read:
        analyse(folder, pool=pool)
    assert read == [folder / "d.mcap"]
    assert pool.begun == 1


@pytest.mark.parametrize(
    "change",
    [{"version": "0"}, {"options": {"factor": 2.0}, "settings": {"factor": 2.0}}],
)
def test_another_version_or_setting_is_another_analysis(folder, monkeypatch, change):
    analyse(folder)
    if "version" in change:
        monkeypatch.setattr(task, "version", lambda _: "0")
        monkeypatch.setattr("motord.batch.stored.version", lambda _: "0")
    assert states(analyse(folder, replace(TASK, **change))) == {"done": 3}
    assert len(values(folder)) == 6


def test_a_file_that_is_replaced_is_analysed(folder):
    analyse(folder)
    os.utime(probe_analysis.write(folder / "new.mcap", 9.0), ns=(0, 10**18 + 1))
    (folder / "new.mcap").replace(folder / "b.mcap")
    assert analyse(folder)["b.mcap"] == ("done", "")
    assert ("b.mcap", 9.0) in values(folder)


def test_a_copy_is_named_and_not_analysed(folder):
    (folder / "0.mcap").write_bytes((folder / "c.mcap").read_bytes())
    found = analyse(folder)
    assert found["c.mcap"] == ("skipped", f"is the same recording as {folder / '0.mcap'}")
    assert [name for name, _ in values(folder)] == ["0.mcap", "a.mcap", "b.mcap"]


def test_what_fails_is_named_with_its_reason_and_set_aside(folder):
    recordings(folder, "raises", "exits", first_Nm=10.0)
    (folder / "cut.mcap").write_bytes((folder / "a.mcap").read_bytes()[:300])
    (folder / "text.mcap").write_text("no recording")
    for path in folder.glob("*.mcap"):
        os.utime(path, ns=(0, 10**18))
    (folder / "gone.mcap").symlink_to(folder / "nowhere")
    found = analyse(folder)
    assert states(found) == {"done": 3, "failed": 5}
    assert found["raises.mcap"] == ("failed", "ZeroDivisionError: two lines")
    assert found["exits.mcap"] == ("failed", "SystemExit: 7")
    assert found["gone.mcap"] == ("failed", "No such file or directory")
    assert "MCAP" in found["text.mcap"][1]
    pool = InlinePool()
    again = analyse(folder, pool=pool)
    assert states(again) == {"skipped": 3, "failed": 5}
    assert pool.calls == []
    assert again["exits.mcap"][1].startswith("SystemExit: 7 (set aside by an earlier run; --retry")
    analyse(folder, pool=pool, retry=True)
    assert len(pool.calls) == 4


def test_what_succeeds_in_the_end_is_no_failure_any_more(folder):
    recordings(folder, "raises", first_Nm=10.0)
    assert analyse(folder)["raises.mcap"][0] == "failed"
    (folder / "raises.mcap").rename(folder / "d.mcap")
    assert analyse(folder)["d.mcap"][0] == "failed"
    assert states(analyse(folder, retry=True)) == {"done": 1, "skipped": 3}
    assert states(analyse(folder)) == {"skipped": 4}


def test_errors_of_the_system_are_not_set_aside(folder, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(task.Recordings, "open", _cannot)
        assert states(analyse(folder)) == {"failed": 3}
    assert states(analyse(folder)) == {"done": 3}


def _cannot(*_):
    raise OSError(5, "Input/output error")


def test_what_changed_meanwhile_is_not_stored(folder):
    class Changing(InlinePool):
        def submit(self, function, *arguments):
            if function is analyse_recordings and arguments[1][0].name == "b.mcap":
                arguments[1][0].write_bytes((folder / "a.mcap").read_bytes())
            return super().submit(function, *arguments)

    found = analyse(folder, pool=Changing())
    assert found["b.mcap"] == ("failed", run.CHANGED)
    assert [name for name, _ in values(folder)] == ["a.mcap", "c.mcap"]


@pytest.mark.parametrize("damage", [Path.unlink, lambda path: path.write_bytes(b"x"), Path.mkdir])
def test_a_result_that_is_gone_or_damaged_is_made_again(folder, damage):
    analyse(folder)
    path = min((folder / "store").glob("*.parquet"))
    if damage is Path.mkdir:
        path.unlink()
        damage(path)
        with suppress(OSError, Exception):
            analyse(folder)
        path.rmdir()
    else:
        damage(path)
    assert states(analyse(folder)) in ({"done": 1, "skipped": 2}, {"skipped": 3})
    assert len(values(folder)) == 3


@given(noise=st.binary(max_size=60) | st.sampled_from([b"{}", b"[]", b"null", b'{"stored": 1}']))
@settings(max_examples=8)
def test_a_damaged_entry_counts_as_none(tmp_path_factory, noise):
    folder = recordings(tmp_path_factory.mktemp("run"), "a")
    analyse(folder)
    [entry] = [one for one in (folder / "store" / ".ledger").iterdir() if "hashes" not in one.name]
    entry.write_bytes(noise)
    assert states(analyse(folder)) == {"done": 1}
    assert json.loads(entry.read_text())["recording"] == "a.mcap"
    assert len(values(folder)) == 1


class KilledHereError(BaseException):
    """A process ends at once: no handler of errors sees it."""


@given(data=st.data(), kills=st.lists(st.integers(0, 12), min_size=1, max_size=3))
@settings(max_examples=10)
def test_killed_at_any_write_nothing_is_twice_and_nothing_is_missing(tmp_path_factory, data, kills):
    """Each run is killed before or after one of its writes, which are atomic; the last is not."""
    folder = recordings(tmp_path_factory.mktemp("run"), "a", "b", "raises", "c")
    for at in kills:
        with pytest.MonkeyPatch.context() as patched, suppress(KilledHereError):
            _kill(patched, at, after=data.draw(st.booleans()))
            analyse(folder)
        found = [name for name, _ in values(folder)]
        assert len(found) == len(set(found))
    last = analyse(folder)
    assert last["raises.mcap"][0] == "failed"
    assert states(last)["failed"] == 1
    assert values(folder) == [("a.mcap", 1.0), ("b.mcap", 2.0), ("c.mcap", 4.0)]
    assert states(analyse(folder)) == {"skipped": 3, "failed": 1}


def _kill(patched, at, *, after):
    left = iter(range(at, -1, -1))

    def killed_in(write):
        def killing(path, content):
            now = next(left, -1) == 0
            if now and not after:
                raise KilledHereError
            write(path, content)
            if now:
                raise KilledHereError

        return killing

    for module in (results_folder, file_hashes):
        patched.setattr(module, "write_whole", killed_in(write_whole))
    patched.setattr(ledger, "write_cached", killed_in(write_cached))


def test_two_runs_at_once_store_each_result_once(folder):
    """One runs whole between the first's look at the ledger and its analyses."""

    class Second(InlinePool):
        def submit(self, function, *arguments):
            if function is analyse_recordings and not (folder / "once").exists():
                (folder / "once").touch()
                assert states(analyse(folder)) == {"done": 3}
            return super().submit(function, *arguments)

    assert states(analyse(folder, pool=Second())) == {"done": 3}
    assert len(values(folder)) == 3


def test_hashes_are_kept_when_hashing_is_interrupted(folder, monkeypatch):
    monkeypatch.setattr(file_hashes, "SAVED_EVERY_S", 1e9)
    kept = Ledger(ResultsStore(folder / "store"))
    kept.make()

    def interrupt(what, done, total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(analyse_into_store(paths(folder), TASK, InlinePool(), kept, interrupt))
    with hashed(monkeypatch) as read:
        assert states(analyse(folder)) == {"done": 3}
    assert len(read) == 1


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"version": "9"}, "a worker has motord"),
        (None, "threads.* with OPENBLAS_NUM_THREADS=1,"),
    ],
)
def test_a_worker_that_would_find_something_else_ends_it(folder, monkeypatch, change, why):
    if change is None:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", "4")
    with pytest.raises(BatchError, match=why):
        analyse(folder, replace(TASK, **(change or {})))
    assert values(folder) == []


def test_a_worker_with_another_bench_file_ends_it(folder, monkeypatch):
    monkeypatch.setattr(run, "settings_to_store", lambda _: {"config": "sha256:1"})
    with pytest.raises(BatchError, match="is not the same on a worker"):
        analyse(folder)
    assert values(folder) == []


def test_a_disk_that_takes_its_time_holds_up_no_other_result(folder, monkeypatch):
    """A result waits for the disk until the next one is being stored, too."""
    both, store = Barrier(2), Ledger.store

    def slow(*arguments):
        both.wait(timeout=30)
        return store(*arguments)

    (folder / "c.mcap").unlink()
    monkeypatch.setattr(Ledger, "store", slow)
    assert states(analyse(folder)) == {"done": 2}


def test_a_disk_that_is_full_ends_it_and_what_was_stored_is_kept(folder, monkeypatch):
    store = Ledger.store

    def full(self, analysis, *result):
        if analysis.recording == "b.mcap":
            raise OSError(errno.ENOSPC, "No space left on device")
        return store(self, analysis, *result)

    with monkeypatch.context() as patched:
        patched.setattr(Ledger, "store", full)
        with pytest.raises(OSError, match="No space"):
            analyse(folder)
    kept = [name for name, _ in values(folder)]
    last = analyse(folder)
    assert last["b.mcap"][0] == "done"
    assert [name for name, (state, _) in last.items() if state == "skipped"] == kept
    assert len(values(folder)) == 3


def test_without_a_store_results_are_values(folder):
    recordings(folder, "raises", first_Nm=10.0)
    one = replace(TASK, to_store=False, to_print=True)
    lines = list(analyse_each(paths(folder), one, InlinePool(), lambda *_: None))
    found = {line.recording.stem: line.content and line.content["torque_Nm"] for line in lines}
    assert found == {"a": 1.0, "b": 2.0, "c": 3.0, "raises": None}
    assert not (folder / "store").exists()
