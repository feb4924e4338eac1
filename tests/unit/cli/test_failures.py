"""Whatever a user does wrong: exit code 1 with one line, or 2 with the usage; never a traceback."""

import json
import resource
import shlex
import socket

import pytest
from typer.testing import CliRunner

from motord.batch.error import WorkerDiedError
from motord.cli import app
from motord.cli.console import explanation
from motord.config.experiments import plan_kinds
from motord.experiments.subject import AnalysisError
from motord.process.ending_threads import NO_THREAD, NoThreadError
from motord.recording.errors import RecordError
from tests.unit.cli.test_text import ALL
from tests.unit.service.live_service import endpoint

LEAVES = {path: c for path, c in ALL.items() if path and not hasattr(c, "list_commands")}
WITHOUT_A_DAEMON = [("archive",)]
ASK_A_DAEMON = [
    path
    for path, command in LEAVES.items()
    if path not in WITHOUT_A_DAEMON and any(one.name == "connect" for one in command.params)
]
NEEDED = {
    ("set",): ["--torque-Nm", "1", "--enable"],
    ("plan", "start"): ["calibrate"],
    ("calibration", "install"): ["good.json"],
    ("calibration", "export"): ["--format", "odrive"],
    ("note",): ["a remark"],
    ("queue", "add"): ["verify"],
    ("queue", "move"): ["1", "1"],
    ("queue", "remove"): ["1"],
    ("test",): ["type.toml", "--serial", "1"],
}
"""What a command needs besides a daemon."""

APPLIED = ("learn", "check-calibration")
"""What is analysed together with the calibration that was in force."""

FILES = [
    "run -c {}",
    "check -c {}",
    "emulate -c {}",
    "emulate -c good.toml --faults {}",
    "fault inject can_drop -c {}",
    "latency -c {} --seconds 0",
    "simulate calibrate -c {} -o new.mcap",
    "simulate verify --calibration {} -o new.mcap",
    *(f"analyse {name} {{}}" for name in plan_kinds() if name not in APPLIED),
    *(f"analyse {name} {{}} -c good.toml --json" for name in plan_kinds() if name not in APPLIED),
    *(f"analyse {name} none.mcap --calibration {{}}" for name in APPLIED),
    *(f"analyse {name} {{}} --calibration good.json" for name in APPLIED),
    "analyse sensitivity --calibration {}",
    "test {} --serial 1",
    "test type.toml --serial 1 --recordings {}",
    "calibration show {}",
    "calibration install {}",
    "calibration export --format odrive {}",
    "calibration export --format odrive good.json -c {}",
    "record info {}",
    "record info {} --check",
    "record recover {}",
    "record export {} -o table.csv",
    "record import {} --map good.toml -o new.mcap",
    "record import table.csv --map {} -o new.mcap",
    "security list --in {}",
    "security add anna --role viewer --in {}",
    "security remove anna --in {}",
    "status --connect tls/127.0.0.1:1 --identity {}",
    "results add {} --store store",
]
NOWHERE = [
    "simulate calibrate --set torques_Nm=2 --set speeds_Hz=1.0 --set turns=2 -o {}.mcap",
    "demo --quick --out {}",
    "latency --seconds 0 --plot {}.png",
    "security init {}",
    "calibration list --dir {}",
    "calibration export --format odrive good.json -o {}",
    "test type.toml --serial 1 --certificate {}/c.html",
    "results add good.json --store {}",
    "results query 'SELECT 1' --store {}",
    "results trend alpha.a --store {}",
    "results compare A B --store {}",
    "analyse calibrate none.mcap --store {}",
    "archive {} --verify",
]
"""Commands that write, or look, where that cannot be."""


@pytest.fixture(scope="module")
def files():
    """Return the text of each file that a command may be given, made once."""
    from motord.config import packaged
    from tests.support.calibrations import calibration

    return {
        "good.json": json.dumps(calibration().to_json()),
        "type.toml": 'motor = "m"\n[[plan]]\nname = "calibrate"\n'
        '[[limit]]\nanalysis = "calibrate"\nfigure = "alpha"\nhigh = 1\n',
        "good.toml": packaged("sim.toml").read_text().replace('rig = "', 'rig = "package:'),
    }


@pytest.fixture(autouse=True)
def folder(files, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def invoke(arguments):
    result = CliRunner().invoke(app, arguments)
    assert isinstance(result.exception, SystemExit | None), repr(result.exception)
    assert "Traceback" not in result.output
    return result


def failed(arguments, *, several=False):
    """Check that a command fails with one line, or one for each thing wrong; return the first."""
    result = invoke(arguments)
    lines = result.stderr.splitlines()
    assert result.exit_code == 1, result.output
    assert len(lines) == 1 or (lines and several), result.stderr
    assert all(line.startswith("motord: ") for line in lines)
    return lines[0]


@pytest.mark.parametrize("path", LEAVES, ids=" ".join)
def test_an_unknown_option_is_wrong_usage(path):
    result = invoke([*path, "--no-such-option"])
    assert result.exit_code == 2
    assert "Usage: " in result.stderr


@pytest.mark.parametrize("path", ASK_A_DAEMON, ids=" ".join)
def test_no_daemon_is_said(path):
    where = endpoint()
    said = failed([*path, *NEEDED.get(path, ()), "--connect", where])
    assert said == f"motord: no motord at {where}: is `motord run` running there?"


@pytest.mark.parametrize(
    "where", ["", "nonsense", "tcp/", "tcp/127.0.0.1:99999", "tcp/[::1", "*/*"]
)
def test_an_endpoint_that_is_none_is_said(where):
    assert where in failed(["status", "--connect", where])


@pytest.mark.parametrize("bench", ["*", "**", "a/b", "x y", "", "#", "$*"])
def test_a_bench_that_is_none_is_said(bench):
    failed(["status", "--connect", endpoint(), "--bench", bench])


@pytest.mark.parametrize("where", ["", ",", "nonsense", "tcp/,nonsense"])
def test_endpoints_that_are_none_are_said(where):
    said = failed(["status", "--all", "--connect", where])
    assert "is no endpoint; those are tcp/HOST:PORT" in said


def test_somebody_else_at_the_endpoint_is_no_daemon():
    with socket.create_server(("127.0.0.1", 0)) as server:
        where = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        server.close()
        assert "no motord at" in failed(["status", "--connect", where])


@pytest.mark.parametrize("kind", ["missing", "folder", "empty", "junk", "json"])
@pytest.mark.parametrize("words", FILES)
def test_a_file_that_cannot_be_is_said(words, kind, folder):
    bad = folder / f"{kind}.mcap"
    contents = {"empty": b"", "junk": bytes(range(256)) * 8, "json": b'{"a": [1, NaN]}'}
    if kind == "folder":
        bad.mkdir()
    elif kind in contents:
        bad.write_bytes(contents[kind])
    failed(shlex.split(words.format(bad)), several=True)


@pytest.mark.parametrize("words", NOWHERE)
def test_what_cannot_be_written_is_one_line(words, folder):
    (folder / "file").write_text("")
    failed(shlex.split(words.format(folder / "file" / "below")))


@pytest.mark.parametrize(
    "words",
    [
        "fault inject no_such_kind -c good.toml",
        "fault inject can_drop fraction -c good.toml",
        "simulate no-such-plan -o new.mcap",
        "simulate json -o new.mcap",  # the name of a method
        "simulate calibrate --set turns=many -o new.mcap",
        "simulate calibrate --set torques_Nm=99 -o new.mcap",
        "simulate calibrate --set no_such_setting=1 -o new.mcap",
        "simulate verify -o new.mcap",
        "record export .",
        "security add anna --role viewer --in .",
        "analyse cogging none.mcap -c none.toml",
        "analyse calibrate none.mcap --store store",
    ],
)
def test_what_cannot_be_done_is_one_line(words):
    failed(shlex.split(words))


@pytest.mark.parametrize(
    "words",
    [
        "set",
        "set --brake 2",
        "set --torque-Nm much",
        "set --compensate all",
        "plan start",
        "plan start calibrate --limit-s -1",
        "plan start calibrate --limit-s 9",
        "events --all --no-follow",
        "queue add --file queue.toml --on-failure skip",
        "queue add --file queue.toml --no-check",
        "archive . --verify --watch",
        "archive . --verify --delete-after-days 1",
        "service install -c good.toml --can-data-bitrate 2000000 --dry-run",
        "plan nothing",
        "analyse calibrate",
        "simulate calibrate --set turns",
        "latency --rate-Hz 1",
        "watch --for-s soon",
        "emulate",
        "record import a.csv",
        "no-such-command",
        "results query",
        "results query 'SELECT 1'",
        "results query 'SELECT 1' --store . --csv --json",
        "results trend alpha.a --by weather --store .",
        "results trend alpha.a --store . -o chart.pdf",
        "results add --store store",
    ],
)
def test_wrong_usage_is_exit_2(words):
    assert invoke(shlex.split(words)).exit_code == 2


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("statu", "No such command 'statu'; did you mean status?"),
        ("analyse cooging x.mcap", "No such command 'cooging'; did you mean cogging?"),
        ("calibration instal x", "No such command 'instal'; did you mean install or list?"),
        ("set --torque-Nm 3,5", "with a decimal point, without its unit, got '3,5'"),
        ("set --torque-Nm 3Nm", "with a decimal point, without its unit, got '3Nm'"),
        ("set --brake 2", "or equal to 1, got '2'"),
        ("set --compensate of", "'--compensate': 'of' is not one of 'off', 'on', "),
        ("queue add verify --wait-until 25:00", "takes a time of day as HH:MM"),
        ("simulate cogging --seed 1.5", "takes a whole number, got '1.5'"),
        ("simulate cogging --set turns=2 --set turns=3", "--set turns: is given twice"),
    ],
)
def test_wrong_usage_names_what_was_typed_and_what_may_be_meant(words, said):
    assert said in " ".join(invoke(shlex.split(words)).stderr.split())


class ErrorOfAPlugin(AnalysisError):
    """What an experiment of another package may raise."""


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (RecordError("a.mcap: is empty"), "a.mcap: is empty"),
        (ErrorOfAPlugin("no whole turn"), "no whole turn"),
        (PermissionError(13, "Permission denied", "a.mcap"), "a.mcap: Permission denied"),
        (WorkerDiedError(), None),
        (ValueError("of the program"), None),
        (RuntimeError("can't start new thread"), NO_THREAD),
        (NoThreadError(NO_THREAD), NO_THREAD),
        (RuntimeError("of the program"), None),
    ],
    ids=lambda one: type(one).__name__,
)
def test_an_error_says_what_is_wrong_unless_it_may_be_one_of_the_program(error, said):
    assert explanation(error) == said


def test_a_working_folder_that_was_removed_is_named(tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert "the working folder was removed" in failed(["run", "-c", "good.toml"])


def test_an_analysis_may_keep_as_many_recordings_open_as_the_system_allows(tmp_path):
    soft, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (512, most))
    try:
        CliRunner().invoke(app, ["analyse", "verify", str(tmp_path / "none.mcap")])
        assert resource.getrlimit(resource.RLIMIT_NOFILE) == (most, most)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, most))
