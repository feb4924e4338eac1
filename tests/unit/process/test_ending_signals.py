"""SIGTERM and SIGHUP end commands that write files as Ctrl-C does: no unfinished file is left."""

import os
import signal
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path
from unittest.mock import MagicMock

import pytest

from motord.cli import COMMANDS, WRITE_FILES
from motord.cli.emulate import emulate
from motord.config import packaged
from motord.process.interrupts import ending_as_interrupts
from motord.process.signal_handlers import INTERRUPTS, put_off
from motord.recording.file_names import part_of
from motord.service.daemon import StopSignal, stop_signals
from tests.unit.recording.runs import write_run

SIMULATE = "simulate calibrate --set torques_Nm=2 --set speeds_Hz=0.6 --set turns=200 -o new.mcap"

COMPILING = "first run: compiling the numerical kernels, which takes a minute or two, once\n"


def ended(folder: Path, command: str, part: str, number: int) -> tuple[int, str]:
    """Return how a command ends that is sent a signal once a file is there, and what it says.

    It gives way to this process, so that it is not done before, however busy the computer is. That
    it compiles kernels, as it does where none are kept, is left out.
    """
    process = subprocess.Popen(
        ["nice", "-n", "19", sys.executable, "-m", "motord", *command.split()],
        cwd=folder, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    end_s = time.monotonic() + 60
    while not (folder / part).exists() and time.monotonic() < end_s and process.poll() is None:
        time.sleep(0.005)
    process.send_signal(number)
    said = process.communicate(timeout=60)[1]
    return process.returncode, said.removeprefix(COMPILING)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "run.mcap"
    write_run(path, 300_000)
    return path


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_table_that_is_written_is_gone(tmp_path, recording, number):
    (tmp_path / "run.mcap").hardlink_to(recording)
    command = "record export run.mcap -o new.csv"
    assert ended(tmp_path, command, "new.csv.part", number) == (
        128 + number,
        "motord: interrupted\n",
    )
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 1)])
def test_a_simulated_recording_is_gone(tmp_path, number, code):
    part = str(part_of(Path("new.mcap")))
    assert ended(tmp_path, SIMULATE, part, number) == (code, "motord: interrupted\n")
    assert not list(tmp_path.iterdir())


def test_commands_that_write_files_are_commands():
    assert set(WRITE_FILES) <= set(COMMANDS)
    assert not {"run", "set", "plan", "watch", "queue", "learn", "test"} & set(WRITE_FILES)


def test_the_first_signal_counts_and_later_ones_do_not_disturb_the_clearing_up():
    before = signal.getsignal(signal.SIGTERM)
    with ending_as_interrupts() as came:
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGHUP)
        os.kill(os.getpid(), signal.SIGTERM)
    assert came == [signal.SIGHUP]
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize("taking", [ending_as_interrupts, stop_signals])
def test_what_is_ignored_stays_so(taking):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with taking() as came:
            os.kill(os.getpid(), signal.SIGHUP)
        assert came in ([], StopSignal(""))
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", INTERRUPTS)
def test_an_emulator_ends_in_good_order(tmp_path, monkeypatch, number):
    class Devices:
        stop = ready = summary = __enter__ = MagicMock(return_value=defaultdict(dict))
        __exit__ = MagicMock(return_value=None)

        def __init__(self, *_):
            self.stop = MagicMock()

        def run(self, _duration_s):
            os.kill(os.getpid(), number)
            self.stop.assert_called_once()

    monkeypatch.setattr("motord.emulate.process.Emulator", Devices)
    emulate(packaged("sim.toml"), tmp_path / "truth.mcap", as_json=True)
    assert [path.name for path in tmp_path.iterdir()] == ["truth.mcap"]


def test_an_emulator_that_is_ended_while_it_starts_leaves_no_file(tmp_path, monkeypatch):
    assert "emulate" in WRITE_FILES
    kill = lambda *_: os.kill(os.getpid(), signal.SIGTERM)  # noqa: E731
    monkeypatch.setattr("motord.emulate.process.Emulator", kill)
    with ending_as_interrupts(), pytest.raises(KeyboardInterrupt):
        emulate(packaged("sim.toml"), tmp_path / "truth.mcap")
    assert not list(tmp_path.iterdir())


def test_a_process_that_was_forked_is_ended():
    with ending_as_interrupts():
        child = os.fork()
        if child == 0:
            os.kill(os.getpid(), signal.SIGTERM)
            os._exit(0)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGTERM


@pytest.mark.parametrize("number", INTERRUPTS)
def test_what_is_put_off_comes_when_the_block_is_over(number):
    done = []

    def interrupt(*_):
        raise KeyboardInterrupt

    def block():
        with put_off(INTERRUPTS):
            os.kill(os.getpid(), number)
            done.append(number)

    before = signal.signal(number, interrupt)
    try:
        with pytest.raises(KeyboardInterrupt):
            block()
        assert done == [number]
        assert signal.getsignal(number) is interrupt
    finally:
        signal.signal(number, before)
