"""Blocks of Python run as they stand there, and commands that take little, on a simulated bench."""

import doctest
import pkgutil
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest
from tools import notebook
from typer.testing import CliRunner, Result

from motord import client as client_package
from motord.cli import app
from motord.client import connect
from tests.docs.blocks import PRINTED, RUN, Block, commands, named, of
from tests.support.patience import until
from tests.system.daemons import Daemon, daemon, wait_for, write_sim

pytestmark = pytest.mark.system

TIMEOUT_S = 120.0


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    """A bench of the name that the docs give, which has recorded something."""
    folder = tmp_path_factory.mktemp("docs")
    path = write_sim(folder, "sim")
    with daemon(folder, path) as running:
        with running.connect() as client:
            with client.lease("docs") as lease:
                client.rpc("enable", token=lease.token)
            wait_for(client, lambda state: state.state != "ENABLED", "disabled")
        until(lambda: list((folder / "runs").glob("*.mcap")), "the recording to be closed")
        yield running


@pytest.fixture(autouse=True)
def reader(bench: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
    """Be where a reader on this computer would be."""
    monkeypatch.chdir(bench.folder)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(bench.folder))
    monkeypatch.setenv("XDG_STATE_HOME", str(bench.folder / "state"))
    monkeypatch.setenv("MOTORD_CONNECT", bench.endpoint)
    monkeypatch.setenv("COLUMNS", "200")


def motord(arguments: list[str]) -> Result:
    """Give a command, which has to succeed."""
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, f"{arguments}: {done.output}"
    return done


@pytest.mark.parametrize("block", of("python"), ids=named)
def test_python_runs(bench: Daemon, block: Block) -> None:
    recordings = sorted((bench.folder / "runs").glob("*.mcap"))
    places = {"endpoint": bench.endpoint, "recording": str(recordings[0])}
    text = block.text
    for there, here in RUN[block.key].items():
        assert there in text, f"{there} is not in the block any more"
        text = text.replace(there, here.format(**places))
    with bench.connect() as client:
        client.stop()
    done = subprocess.run(
        [sys.executable, "-c", text], check=False, capture_output=True, text=True, timeout=TIMEOUT_S
    )
    assert (done.returncode, done.stderr) == (0, "")
    for printed in PRINTED[block.key]:
        assert printed in done.stdout, done.stdout


def examples() -> Iterator[doctest.DocTest]:
    """Yield the docstrings of the client that have examples."""
    package, finder = client_package.__name__, doctest.DocTestFinder(exclude_empty=True)
    for name in ("", *(f".{m.name}" for m in pkgutil.iter_modules(client_package.__path__))):
        yield from (found for found in finder.find(import_module(package + name)) if found.examples)


@pytest.mark.parametrize("example", list(examples()), ids=lambda found: found.name)
def test_examples_of_the_client(example: doctest.DocTest) -> None:
    said: list[str] = []
    with connect() as client:
        client.stop()
        example.globs["client"] = client
        runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
        runner.run(example, out=said.append, clear_globs=False)
    assert not runner.summarize(verbose=False).failed, "".join(said)


def test_the_notebook_runs(bench: Daemon, tmp_path: Path) -> None:
    script = notebook.SCRIPT.read_text()
    for there, here in (
        ("TURNS = 4", "TURNS = 2"), ("SPEED_Hz = 1.0", "SPEED_Hz = 2.0"),
        ('"turns": 4', '"turns": 2, "spin_up": 1.0'),
    ):  # fmt: skip
        assert there in script
        script = script.replace(there, here)  # half the time, or less
    with bench.connect() as client:
        client.stop()
    shown = notebook.run(script, tmp_path)
    assert "cogging done: 1 of 1 points\n" in "".join(each.printed for each in shown)
    drawn = [name for each in shown for name in each.pictures]
    assert drawn == notebook.pictures(notebook.PAGE.read_text())
    assert all((tmp_path / name).stat().st_size for name in drawn)


def test_certificates_as_in_the_guide(tmp_path: Path) -> None:
    [block] = [b for b in of("console") if "security init" in b.text]
    said = ""
    for command in commands(block):
        program, *arguments = command.split()
        if program == "motord":
            arguments = [
                str(tmp_path / "access") if w == "/etc/motord/access" else w for w in arguments
            ]
            said = motord(arguments).stdout
    assert "anna" in said
    assert "ben" in said


@pytest.mark.parametrize("command", ["status", "watch --for-s 0", "plan list", "record --help"])
def test_commands_that_only_look(command: str) -> None:
    done = motord(command.split())
    assert done.stdout
    assert not done.stderr
