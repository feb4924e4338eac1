"""The first day: a wheel in an empty folder is enough, and `motord new` asks what it needs."""

import os
import pty
import re
import select
import subprocess
import sys
import sysconfig
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from motord.config import load

pytestmark = pytest.mark.system

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src" / "motord"
TIMEOUT_S = 600.0

Motord = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "wheel", "--quiet"]
    alone = ["--no-build-isolation", "--no-deps", "--no-index"]
    subprocess.run([*pip, *alone, "-w", folder, ROOT], check=True, timeout=TIMEOUT_S)
    [built] = folder.glob("motord-*.whl")
    return built


@pytest.fixture(scope="module")
def motord(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Motord:
    """Return what runs the installed program; other packages are those of this environment."""
    folder = tmp_path_factory.mktemp("installed")
    venv, empty = folder / "venv", folder / "empty"
    empty.mkdir()
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", venv], check=True)
    python = venv / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", python]
    # compiled when they are used, as most modules are not
    install = ["install", "--quiet", "--no-compile", "--no-deps", "--no-index", wheel]
    subprocess.run([*pip, *install], check=True, timeout=TIMEOUT_S)
    [packages] = venv.glob("lib/python*/site-packages")
    (packages / "others.pth").write_text(sysconfig.get_path("purelib") + "\n")
    environment = {
        **{name: text for name, text in os.environ.items() if name != "PYTHONPATH"},
        "PATH": f"{venv / 'bin'}:{os.environ['PATH']}",
        "XDG_RUNTIME_DIR": str(folder),
        "XDG_STATE_HOME": str(folder / "state"),
        "XDG_CACHE_HOME": str(folder / "cache"),
        "COLUMNS": "200",
    }

    def run(*arguments: str) -> "subprocess.CompletedProcess[str]":
        done = subprocess.run(
            ["nice", "-n19", "motord", *arguments], cwd=empty, env=environment, timeout=TIMEOUT_S,
            capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False,
        )  # fmt: skip
        assert done.returncode == 0, f"{arguments}\n{done.stdout}{done.stderr}"
        return done

    return run


def tracked_data() -> set[str]:
    """Return the files of the package that are no Python, links to folders followed."""
    found = [
        Path(folder, name)
        for folder, _, names in os.walk(PACKAGE, followlinks=True)
        for name in names
    ]
    return {
        str(path.relative_to(PACKAGE.parent))
        for path in found
        if "__pycache__" not in path.parts and path.suffix != ".py"
    }


def test_the_wheel_has_all_data(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    data = tracked_data()
    assert data <= names
    for sample in (
        "motord/data/systemd/motord.service", "motord/data/systemd/user/motord.service",
        "motord/data/examples/bench.toml", "motord/data/drives/vesc.toml",
        "motord/data/inverter.dbc", "motord/proto/tick.proto",
        "motord/dashboard/static/vendor/uPlot.esm.js",
    ):  # fmt: skip
        assert sample in data
    assert not any(name.startswith(("tests/", "systemd/", "config/")) for name in names)


def test_a_bench_file_and_a_service_from_the_wheel(motord: Motord) -> None:
    help_text = motord("--help").stdout
    assert "new" in help_text
    assert "service" in help_text
    assert motord("--version").stdout.startswith("motord ")
    motord("new", "real.toml", "--template", "serial-bridge", "--inverter", "moteus", "--yes")
    shown = motord("service", "install", "--dry-run", "-c", "real.toml").stdout
    assert re.search(
        r"^\+ExecStart=\S+/bin/motord run --config /etc/motord/bench.toml$", shown, re.M
    )
    assert '+KERNEL=="cpu_dma_latency"' in shown
    assert shown.endswith("nothing was changed\n")


@pytest.mark.long
def test_the_first_minute_from_the_wheel(motord: Motord) -> None:
    """Kernels are compiled anew here, which takes most of the time."""
    motord("new", "bench.toml", "--template", "simulated", "--yes")
    assert "inverter and bridge: ok, sim" in motord("check", "-c", "bench.toml").stdout
    said = motord("demo", "--quick").stdout
    assert re.search(r"mean [\d.]+ % before, 0\.\d+ % after", said)
    assert "report: demo-out/report.html" in said


class Terminal:
    """A person at a terminal: waits for words of a question, then answers."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.said = ""
        self.answered: list[str] = []
        self._own, other = pty.openpty()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "motord", *arguments],
            cwd=folder, stdin=other, stdout=other, stderr=other,
        )  # fmt: skip
        os.close(other)

    def question(self) -> str:
        """Wait for the next question; return it, "" at the end."""
        said = ""
        while not re.search(r"\]: $", said):
            assert select.select([self._own], [], [], TIMEOUT_S)[0], self.said
            with suppress(OSError):  # the other end is closed
                piece = os.read(self._own, 1 << 16).decode()
                said, self.said = said + piece, self.said + piece
                continue
            return ""
        return said.rpartition("\n")[2]

    def answer(self, text: str) -> None:
        os.write(self._own, f"{text}\n".encode())

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self._own)


def test_on_a_terminal_it_asks(tmp_path: Path) -> None:
    """A wrong answer is asked again at once; what does not go together, from the beginning."""
    answers = {
        "Which bench": ["serial", "serial-bridge"],
        "Inverter [": ["moteus"],
        "pole pairs": ["many", "4"],
        "windings": ["independent", "star"],
        "Brake (": ["none"],
        "External drive, ": ["none"],
    }
    asked: list[Any] = []
    person = Terminal(tmp_path, "new", "first.toml", "--motor-slots", "36")
    try:
        while question := person.question():
            asked.append(question)
            person.answer(
                next(
                    (left.pop(0) for part, left in answers.items() if part in question and left),
                    "",
                )
            )
        assert person.process.wait(TIMEOUT_S) == 0, person.said
    finally:
        person.close()
    assert answers == {part: [] for part in answers}
    assert "one of simulated, emulated" in person.said
    assert "it takes a star" in person.said.replace("\r\n", " ")
    assert not any("Modbus" in question for question in asked)
    assert sum("slots" in question for question in asked) == 1  # once it did not go together
    bench = load(tmp_path / "first.toml")
    assert (bench.motor.pole_pairs, bench.motor.slots) == (4, 36)
    assert (bench.motor.connection, bench.bench.name) == ("star", "first")
    assert bench.brake.driver == bench.drive.driver == "none"
    assert "next:" in person.said
