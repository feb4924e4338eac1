"""A Ctrl-C that comes where Python lets no exception out is not lost."""

import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import NoReturn

import pytest
from pydantic_core import SchemaError

import motord.cli
from motord.__main__ import main
from motord.cli.console import interrupt_was_converted

PROGRAM = """
import os, sys, time, weakref
from contextlib import nullcontext
from motord.cli.bench.lease_session import interrupted_once
from motord.process.interrupts import recover_lost_interrupts

if "recover" in sys.argv:
    recover_lost_interrupts()

def interrupted(*_):
    os.kill(os.getpid(), int(sys.argv[1]))
    time.sleep(0)  # where the handler runs

class Finalised:
    __del__ = interrupted

class Referenced:
    pass

def lose():
    if "finaliser" in sys.argv:
        Finalised()
    else:
        one = Referenced()
        reference = weakref.ref(one, interrupted)
        del one

try:
    with interrupted_once() if "once" in sys.argv else nullcontext():
        lose()
        time.sleep(0.5)
    print("lost")
except KeyboardInterrupt:
    print("interrupted")
"""


def ran(*arguments: str, number: int = signal.SIGINT) -> tuple[str, str]:
    """Return what a program prints that is interrupted where an exception is lost, and stderr."""
    command = [sys.executable, "-c", textwrap.dedent(PROGRAM), str(int(number)), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout.strip(), done.stderr.strip()


@pytest.mark.parametrize("block", ["once", "default"])
@pytest.mark.parametrize("where", ["finaliser", "reference"])
def test_an_interrupt_that_is_lost_comes_again(where: str, block: str) -> None:
    assert ran("recover", where, block) == ("interrupted", "")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_so_does_any_signal_that_ends_a_command(number: int) -> None:
    assert ran("recover", "reference", "once", number=number) == ("interrupted", "")


def test_without_recovery_it_is_lost() -> None:
    shown, said = ran("reference", "once")
    assert shown == "lost"
    assert "KeyboardInterrupt" in said


def leave_the_process_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the command line change nothing of the process that it runs in."""
    for name in ("shield_from_working_folder", "recover_lost_interrupts", "outlive_readers"):
        monkeypatch.setattr(motord.cli, name, lambda: None)
    monkeypatch.setattr(motord.cli, "end_process", sys.exit)


def test_the_command_line_recovers_it(monkeypatch: pytest.MonkeyPatch) -> None:
    recovered = []
    leave_the_process_alone(monkeypatch)
    monkeypatch.setattr(motord.cli, "recover_lost_interrupts", lambda: recovered.append(True))
    monkeypatch.setattr(sys, "argv", ["motord", "--version"])
    with pytest.raises(SystemExit):
        main()
    assert recovered == [True]


@pytest.mark.parametrize(
    ("where", "raised"),
    [
        ("motord.cli.main", KeyboardInterrupt()),  # while modules are loaded
        ("motord.cli.app", SystemExit(130)),  # while the command line is read
        ("typer.core.TyperGroup.invoke", KeyboardInterrupt()),
        ("typer.core.TyperGroup.invoke", SchemaError("validator:\n  KeyboardInterrupt: ")),
    ],
)
def test_an_interrupted_command_says_so_in_one_line(
    where: str,
    raised: BaseException,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def interrupted(*_: object, **__: object) -> NoReturn:
        raise raised

    leave_the_process_alone(monkeypatch)
    monkeypatch.setattr(sys, "argv", ["motord", "status"])
    monkeypatch.setattr(where, interrupted)
    with pytest.raises(SystemExit) as ended:
        main()
    assert (ended.value.code, capsys.readouterr().err) == (1, "motord: interrupted\n")


def test_an_error_of_the_program_is_none() -> None:
    assert not interrupt_was_converted(ValueError("KeyboardInterrupt"))
    assert not interrupt_was_converted(SchemaError("a model that makes no sense"))


ENTRY = """
import sys
import motord.cli
from motord.__main__ import main

def command_line():
    try:
        exec("raise KeyboardInterrupt")
    except KeyboardInterrupt:
        sys.exit(1)

motord.cli.main = command_line
if "as it is" in sys.argv:
    command_line()
main()
"""


@pytest.mark.parametrize(("how", "code"), [("with ours", 1), ("as it is", -signal.SIGINT)])
def test_an_interrupt_in_an_exec_that_was_taken_does_not_end_the_process(
    how: str, code: int, tmp_path: Path
) -> None:
    """Python remembers it until the next exec, and ends `python -m` as if nobody had taken it."""
    (tmp_path / "entry.py").write_text(ENTRY)
    done = subprocess.run([sys.executable, "-m", "entry", how], cwd=tmp_path, check=False)
    assert done.returncode == code
