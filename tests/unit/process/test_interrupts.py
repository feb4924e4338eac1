"""A Ctrl-C that comes where Python lets no exception out is not lost."""

import signal
import subprocess
import sys
import textwrap

import pytest

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


def test_the_command_line_recovers_it(monkeypatch: pytest.MonkeyPatch) -> None:
    import motord.cli

    recovered = []
    monkeypatch.setattr(motord.cli, "recover_lost_interrupts", lambda: recovered.append(True))
    monkeypatch.setattr(motord.cli, "outlive_readers", lambda: None)
    monkeypatch.setattr(sys, "argv", ["motord", "--version"])
    with pytest.raises(SystemExit):
        motord.cli.main()
    assert recovered == [True]
