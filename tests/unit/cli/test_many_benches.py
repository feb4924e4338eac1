"""`--all` of status, watch and events, and `motord archive`, before played benches."""

import json
import threading

import pytest
from typer.testing import CliRunner

from motord.api.messages import RecordingView
from motord.cli import app
from motord.cli.bench import overview
from motord.client import benches
from tests.support.patience import PATIENCE_S
from tests.support.played_benches import await_answers, endpoint, played, publishing, router
from tests.unit.archive.test_faults import recordings


def motord(*words, code=0):
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert isinstance(done.exception, SystemExit | None), repr(done.exception)
    assert done.exit_code == code, done.output
    return done


def test_a_line_for_each_bench_and_one_that_hangs_comes_last():
    with (
        played("a", "b") as (a, b),
        played("stuck", answers=False) as (stuck,),
        router(a.listen, b.listen, stuck.listen) as (listen, _),
        publishing(a, b),
    ):
        lines = motord("status", "--all", "--connect", listen).stdout.splitlines()
        assert sorted(line.split()[0] for line in lines[:2]) == ["a", "b"]
        assert all("OFF; not recording; 0." in line for line in lines[:2])
        assert lines[2:] == [f"{'stuck':16} no state; SILENT: no answer"]
        objects = motord("status", "--all", "--json", "--connect", listen).stdout.splitlines()
        shown = {one["bench"]: one for one in map(json.loads, objects)}
        assert (shown["a"]["state"]["state"], shown["a"]["daemons"]) == ("OFF", 1)
        assert (shown["stuck"]["silent"], shown["stuck"]["state"]) == (True, None)


def test_several_endpoints_and_one_that_is_not_there():
    with played("a", "b") as (a, b), publishing(a, b):
        nobody = endpoint()
        done = motord(
            "status", "--all", "--connect", f"{a.listen},{nobody},{b.listen}", code=1
        )  # fmt: skip
        assert sorted(line.split()[0] for line in done.stdout.splitlines()) == ["a", "b"]
        assert f"no motord at {nobody}" in done.stderr


def test_nobody_is_said():
    assert "no motord at" in motord("status", "--all", "--connect", endpoint(), code=1).stderr
    with router() as (listen, _):
        assert "no bench at" in motord("status", "--all", "--connect", listen, code=1).stderr
    assert "leave --bench out" in motord("status", "--all", "--bench", "a", code=2).stderr


def test_two_of_one_name_are_said():
    with (
        played("a", "a") as (one, other),
        router(one.listen, other.listen) as (listen, session),
        publishing(one, other),
    ):
        await_answers(session, "a", 2)
        assert "2 DAEMONS HAVE THIS NAME" in motord("status", "--all", "--connect", listen).stdout
        assert "have the name 'a'" in motord("status", "--connect", listen, code=1).stderr


def test_what_becomes_of_the_benches_is_a_line_each(monkeypatch):
    lines = []
    gone = threading.Event()

    def take(answer, line, as_json):
        lines.append(line)
        if "OFF" in line and "SILENT" not in line and not gone.is_set():
            gone.set()
            threading.Thread(target=a.close).start()
        if overview.GONE in line:
            raise KeyboardInterrupt  # as by Ctrl-C, however late it comes

    monkeypatch.setattr(overview, "print_answer", take)
    with played("a") as (a,), router(a.listen) as (listen, _), publishing(a):
        motord("watch", "--all", "--connect", listen)
    assert overview.GONE in lines[-1]


def test_a_watch_of_all_lasts_from_its_first_line_on(monkeypatch):
    monkeypatch.setattr(benches, "ANSWER_S", PATIENCE_S)
    with played("a") as (a,), router(a.listen) as (listen, _), publishing(a):
        done = motord("watch", "--all", "--for-s", "0", "--connect", listen)
        assert " a " in done.stdout


def test_a_watch_of_no_bench_ends(monkeypatch):
    monkeypatch.setattr(benches, "ANSWER_S", 0.0)
    with router() as (listen, _):
        assert motord("watch", "--all", "--for-s", "0", "--connect", listen).stdout == ""


def test_recordings_are_archived_unless_the_bench_is_needed(tmp_path):
    source, copies, content = recordings(tmp_path)
    words = ("archive", copies, "--from", source)
    recorded = RecordingView(recording=True, path="x.mcap.part")
    with played("a") as (a,):
        with publishing(a, recording=recorded):
            done = motord(*words, "--connect", a.listen, code=1)
            assert "stopped, as bench a records; the next run goes on" in done.stderr
            assert not list(copies.rglob("*.mcap"))
        with publishing(a):
            done = motord(*words, "--connect", a.listen, "--limit-MB-per-s", 50)
            assert done.stdout.splitlines()[-1] == "2 copied, 0 archived before"
    report = json.loads(motord(*words, "--connect", endpoint(), "--json").stdout)
    assert (report["there"], report["copied"]) == (2, [])
    assert motord("archive", "--verify", copies).stdout == "2 as archived, 0 not\n"
    name = next(iter(content))
    (copies / name).write_bytes(b"x")
    done = motord("archive", "--verify", copies, "--json", code=1)
    assert list(json.loads(done.stdout)["differing"]) == [name]


@pytest.mark.parametrize(
    ("words", "said", "code"),
    [
        ("s3://bucket --from .", "is a URL", 2),
        ("gone --from .", "no such folder; is it mounted?", 1),
        (". --from gone", "no folder of recordings", 1),
        (". --from . --watch", "is where the recordings are; name another folder", 1),
        ("gone --verify", "no such folder; is it mounted?", 1),
    ],
)
def test_what_cannot_be_archived_is_one_line(words, said, code, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = motord("archive", *words.split(), "--connect", endpoint(), code=code)
    assert said in " ".join(done.stderr.split())
