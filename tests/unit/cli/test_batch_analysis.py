"""`motord analyse KIND` of many recordings: when it is meant, what it refuses, what it prints."""

import json
import sys

import pytest
from typer.testing import CliRunner

from motord.batch import dask_pool
from motord.cli import app, batch_analysis
from motord.process.one_thread import ONE_THREAD
from motord.results.store import ResultsStore
from tests.support import probe_analysis
from tests.unit.batch.pools import InlinePool


class Workers(InlinePool):
    """In place of Dask's. asked: number of workers and address of the scheduler."""

    asked = ()

    def __init__(self, workers, scheduler, remark, modules):
        super().__init__()
        Workers.asked = workers, scheduler
        assert modules == [probe_analysis.__name__]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


@pytest.fixture
def folder(tmp_path, monkeypatch):
    probe_analysis.register(monkeypatch)
    monkeypatch.setattr(dask_pool, "DaskPool", Workers)
    for name, one in ONE_THREAD.items():
        monkeypatch.setenv(name, one)
    monkeypatch.delenv("MOTORD_STORE", raising=False)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs" / "deep").mkdir(parents=True)
    for number, name in enumerate(("a", "deep/b", "raises", "z"), start=1):
        probe_analysis.write(tmp_path / "runs" / f"{name}.mcap", float(number))
    return tmp_path


def motord(*words, code=0):
    done = CliRunner().invoke(app, ["analyse", probe_analysis.NAME, *words])
    assert isinstance(done.exception, SystemExit | None), repr(done.exception)
    assert done.exit_code == code, done.output
    return done


@pytest.mark.parametrize(
    "words", [["runs"], ["runs/**/*.mcap"], ["runs/a.mcap", "runs/*/b.mcap", "--workers", "2",
                                             "runs/raises.mcap", "runs/z.mcap"]],
)  # fmt: skip
def test_a_folder_a_pattern_or_workers_mean_each(folder, words):
    done = motord(*words, "--store", "s", code=1)
    assert done.stdout == "4 recordings: 3 done, 0 skipped, 1 failed\n"
    assert done.stderr == "motord: runs/raises.mcap: ZeroDivisionError: two lines\n"
    values = ResultsStore(folder / "s").read().table["value"].to_pylist()
    assert sorted(values) == [1.0, 2.0, 4.0]
    done = motord(*words, "--store", "s", code=1)
    assert done.stdout == "4 recordings: 0 done, 3 skipped, 1 failed\n"


def test_recordings_by_name_are_still_analysed_together(folder):
    done = motord("runs/a.mcap", "--store", "s")
    assert done.stdout == "torque 1 Nm\n"
    done = CliRunner().invoke(app, ["analyse", "probe", "runs/a.mcap", "runs/z.mcap"])
    assert isinstance(done.exception, ValueError)  # of one recording alone
    Workers.asked = ()
    motord("runs/a.mcap", "--scheduler", "tcp://there:8786", "--json")
    assert Workers.asked == (1, "tcp://there:8786")


def test_lines_of_json_are_in_the_order_of_the_recordings(folder, monkeypatch):
    monkeypatch.setattr(batch_analysis, "_lines", _backwards(batch_analysis._lines))
    done = motord("runs", "--json", "--workers", "7", code=1)
    *lines, last = map(json.loads, done.stdout.splitlines())
    assert Workers.asked == (4, None)
    assert [line["recording"] for line in lines] == [
        "runs/a.mcap", "runs/deep/b.mcap", "runs/raises.mcap", "runs/z.mcap",
    ]  # fmt: skip
    assert [line["state"] for line in lines] == ["done", "done", "failed", "done"]
    assert [line["result"] and line["result"]["torque_Nm"] for line in lines] == [1, 2, None, 4]
    assert last == {"summary": {"recordings": 4, "done": 3, "skipped": 0, "failed": 1}}


def _backwards(lines):
    def backwards(*arguments):
        return sorted(lines(*arguments), key=lambda one: one.recording, reverse=True)

    return backwards


def test_what_is_done_is_shown_when_it_is_interrupted(folder, monkeypatch):
    whole = batch_analysis._lines

    def interrupted(*arguments):
        lines = sorted(whole(*arguments), key=lambda one: one.recording)
        yield from lines[1:3]
        raise KeyboardInterrupt

    monkeypatch.setattr(batch_analysis, "_lines", interrupted)
    done = motord("runs", "--store", "s", code=1)
    assert done.stdout == "4 recordings: 1 done, 0 skipped, 1 failed, 2 not analysed\n"
    assert done.stderr.splitlines()[-1] == "motord: interrupted"
    done = motord("runs", "--json", code=1)
    assert [json.loads(line).get("recording") for line in done.stdout.splitlines()] == [
        "runs/deep/b.mcap", "runs/raises.mcap", None,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["runs"], "--store DIR, or --json"),
        (["runs", "--json", "-o", "x.json"], "--output is of one result"),
        (["runs", "--json", "--report", "x.html"], "--report is of one result"),
        (["runs", "--json", "--workers", "2", "--scheduler", "tcp://a:1"], "--workers or"),
        (["runs", "--json", "--scheduler", "nonsense"], "needed is tcp://HOST:PORT"),
        (["runs", "--json", "--workers", "0"], "greater than or equal to 1"),
        (["runs/a.mcap", "--retry"], "with --workers"),
        (["runs/a.mcap", "--rehash"], "with --workers"),
    ],
)
def test_what_is_refused(folder, words, why):
    assert why in " ".join(motord(*words, code=2).stderr.replace("│", " ").split())


def test_no_recordings_is_an_error(folder):
    assert motord("runs/*.txt", "--json", code=1).stderr == (
        "motord: runs/*.txt: no recordings there\n"
    )
    assert motord("runs/none.mcap", "--json", "--workers", "1", code=1).stderr.startswith(
        "motord: runs/none.mcap: cannot read it: No such file or directory"
    )


def test_a_missing_package_is_named_with_what_to_do(folder, monkeypatch):
    monkeypatch.undo()
    probe_analysis.register(monkeypatch)
    monkeypatch.setitem(sys.modules, "distributed", None)
    done = motord(str(folder / "runs"), "--json", code=1)
    assert "pip install 'motord[cluster]'" in done.stderr
