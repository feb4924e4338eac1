"""The steps of docs/bring-up.md, run as they stand there against the emulator.

Comments before a block say what to do with it: `run`, `run, ends with 1`, `run in the background`,
`expect` (of what the block before printed; `...` is anything), `bench.toml` (settings to take
over), `devices on`, `stop the daemon`, `not run: why`, `not applied: why`.
"""

import ast
import os
import re
import subprocess
import sys
import tomllib
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from motord.api.messages import BenchState
from motord.calibration import load as load_calibration
from motord.client import connect
from motord.config import load, packaged
from motord.config.text.editing import with_values
from tests.support import stalls
from tests.support.patience import PATIENCE_S
from tests.system.daemons import Program, emulator, patient
from tests.unit.emulate.benches import write_bench

GUIDE = Path(__file__).parents[2] / "docs" / "bring-up.md"
SOURCES = Path(__file__).parents[2] / "src"

SHORT = """
[plans.align]
turns = 1
rests = 34
currents_A = [7.0]

[plans.calibrate]
torques_Nm = [1.0, 2.0]
speeds_Hz = [1.0]
turns = 7
settle_s = 0.3
speed_tolerance = 0.2
gain_steps = []

[plans.verify]
torques_Nm = [2.0]
speeds_Hz = [1.0]
turns = 5
settle_s = 0.5
speed_tolerance = 0.2
"""
"""With 34 rests `align` states the encoder's zero to 0.08 deg (95 %); `calibrate` with these
settings notices it from 0.1 deg on."""
BENCH_STALE_S = 1.0
STALLED = "published no tick|rotor came to rest at|speed was still"
"""What a command says, without a trip, of a bench on a computer too busy to be one."""

TRUTH_OFFSET_RAD = 4.4
TRUTH_ALPHA = (0.8, 1.118, 1.118)


@dataclass(frozen=True)
class Step:
    """A comment of the guide, and the block after it, if one is due."""

    what: str
    lines: list[str] = field(default_factory=list)


def steps_of(text: str) -> list[Step]:
    """Return the steps of a guide; every block of commands has to say what to do with it."""
    steps: list[Step] = []
    what = ""
    for found in re.finditer(r"^<!-- (.*?) -->$|^```(\w+)\n(.*?)^```$", text, re.M | re.S):
        comment, language, block = found.groups()
        if comment is not None:
            if comment in ("devices on", "stop the daemon"):
                steps.append(Step(comment))
            else:
                what = comment
            continue
        assert what, f"what to do with this block of {language}?\n{block}"
        steps.append(Step(what, block.splitlines()))
        what = ""
    return steps


def matches(expected: str, printed: str) -> bool:
    """Return whether a line, with `...` for anything, is one of those printed."""
    parts = [re.escape(part) for part in re.split(r"\s*\.\.\.\s*", expected.strip())]
    pattern = r".*".join(re.sub(r"(\\ )+", r"\\s+", part) for part in parts)
    return any(re.fullmatch(pattern, line.strip()) for line in printed.splitlines())


def write_misaligned(folder: Path) -> Path:
    """Write the emulated bench, of whose phases and encoder the file says nothing right."""
    truth = packaged("report.rig.toml").read_text()
    truth = truth.replace("[inverter]\n", '[inverter]\nphase_order = "acb"\n')
    encoder = f"[encoder]\noffset_rad = {TRUTH_OFFSET_RAD}\ndirection = -1\n"
    (folder / "rig.toml").write_text(truth.replace("\n[encoder]\n", f"\n{encoder}"))
    path = write_bench(folder, {'"package:report.rig.toml"': '"rig.toml"'})
    text = re.sub(r"^\[plans\..*?(?=^\[|\Z)", "", path.read_text(), flags=re.M | re.S)
    text = patient(text, "bench-1", 500)
    text = text.replace("[brake]\n", "[brake]\nstale_after_s = 5.0\n")
    path.write_text(text + SHORT)
    return path


class Reader:
    """Does what the guide says, in a folder of its own."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self.folder, self.bench = folder, write_misaligned(folder)
        self._stack = stack
        self._daemon: Program | None = None
        self._printed = ""
        shim = folder / "bin" / "motord"
        shim.parent.mkdir()
        shim.write_text(f'#!/bin/sh\nexec {sys.executable} -m motord "$@"\n')
        shim.chmod(0o755)
        self._environment = dict(
            os.environ,
            PATH=f"{shim.parent}:{os.environ['PATH']}",
            XDG_RUNTIME_DIR=str(folder),
            XDG_STATE_HOME=str(folder / "state"),
            MOTORD_CONNECT=load(self.bench).zenoh.listen[0],
            COLUMNS="200",
        )

    def do(self, step: Step) -> None:
        """Do one step."""
        if step.what == "devices on":
            self._stack.enter_context(emulator(self.folder, self.bench, self.folder / "t.mcap"))
        elif step.what == "stop the daemon":
            assert self._daemon is not None
            assert self._daemon.end() == 0, self._daemon.said()
            self._daemon = None
        elif step.what == "bench.toml":
            self._take_over("\n".join(step.lines))
        elif step.what == "run in the background":
            [command] = step.lines
            self._daemon = Program(self.folder, *command.split()[1:])
            self._stack.callback(self._daemon.close)
            self._printed = self._daemon.first_line
        elif step.what.startswith("run"):
            ends_with = int((re.search(r"ends with (\d)", step.what) or [0, "0"])[1])
            self._printed = "".join(self._run(command, ends_with) for command in step.lines)
        elif step.what == "expect":
            missing = [line for line in step.lines if not matches(line, self._printed)]
            assert not missing, f"not printed: {missing}\nprinted:\n{self._printed}"
        else:
            assert step.what.startswith(("not run: ", "not applied: ")), step.what

    def _run(self, command: str, ends_with: int) -> str:
        """Run a command; what a computer too busy for the bench explains costs another try."""
        while True:
            kept = stalls.of_bench(self._state()) if self._daemon else stalls.Stalls()
            done = self._shell(command)
            if done.returncode == ends_with:
                return done.stdout + "\n"
            assert self._daemon is not None, f"{command}\n{done.stdout}"
            state = self._state()
            cause = state.first_trip if state.state == "TRIPPED" else ""
            if not cause and re.search(STALLED, done.stdout):
                cause = "timeout"
            where = f"{command}\n{done.stdout}\n{self._daemon.said()}\n"
            stalls.forgive(where, cause, kept, BENCH_STALE_S, state.loop.missed)
            assert self._shell("motord reset").returncode == 0

    def _state(self) -> BenchState:
        with connect(None, self._environment["MOTORD_CONNECT"]) as client:
            return client.state()

    def _shell(self, command: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            command, shell=True, cwd=self.folder, env=self._environment, timeout=PATIENCE_S,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
        )  # fmt: skip

    def _take_over(self, settings: str) -> None:
        text = self.bench.read_text()
        for table, values in tomllib.loads(settings).items():
            text = with_values(text, table, values, str(self.bench))
        self.bench.write_text(text)


@pytest.mark.system
@pytest.mark.long
def test_the_guide_brings_up_the_emulated_bench(tmp_path: Path) -> None:
    steps = steps_of(GUIDE.read_text())
    assert sum(step.what.startswith("run") for step in steps) >= 9
    with ExitStack() as stack:
        reader = Reader(tmp_path, stack)
        for step in steps:
            reader.do(step)
    motor = load(reader.bench).motor
    assert (motor.phase_order, motor.encoder_direction) == ("acb", -1)
    period_rad = 2 * np.pi / motor.pole_pairs
    off_rad = (motor.encoder_offset_rad - TRUTH_OFFSET_RAD + period_rad / 2) % period_rad
    assert abs(off_rad - period_rad / 2) < 6 * 2 * np.pi / motor.counts
    alpha = load_calibration(tmp_path / "calibration.json").alpha
    assert alpha == pytest.approx(TRUTH_ALPHA, rel=0.05)


def test_blocks_of_which_nobody_says_what_to_do_are_found() -> None:
    with pytest.raises(AssertionError, match="what to do with this block"):
        steps_of("<!-- run -->\n```sh\na\n```\n```sh\nb\n```\n")
    [step] = steps_of("<!-- run -->\n```sh\na\nb\n```\n")
    assert step == Step("run", ["a", "b"])


def test_what_is_printed_is_compared_with_dots_for_anything() -> None:
    assert matches("state ... OFF", "bench  b\nstate        OFF   \n")
    assert matches("a ... c ...", "a b c d")
    assert not matches("state ... OFF", "state  OFF now")


def spoken() -> str:
    """Return all text of the program's strings, what is filled in left out."""
    texts = []
    for path in SOURCES.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                texts.append(node.value)
            elif isinstance(node, ast.JoinedStr):
                parts = [p.value if isinstance(p, ast.Constant) else "\0" for p in node.values]
                texts.append("".join(map(str, parts)))
    return "\n".join(texts).lower()


def test_the_messages_that_the_guide_explains_are_those_of_the_program() -> None:
    table = GUIDE.read_text().split("## What each message means")[1]
    messages = re.findall(r"^\| `(.*?)` \|", table, re.M)
    assert len(messages) > 15
    said = spoken()
    for message in messages:
        for part in message.lower().split("..."):
            assert part.strip(" :") in said, f"no part of the program says: {part}"


def test_the_drawing_is_that_of_its_script(tmp_path: Path) -> None:
    root = GUIDE.parents[1]
    script = [sys.executable, str(root / "tools" / "wiring.py"), str(tmp_path / "wiring.svg")]
    subprocess.run(script, check=True, timeout=60)
    drawn = (tmp_path / "wiring.svg").read_text()
    assert drawn == (root / "docs" / "images" / "wiring.svg").read_text()
