"""An experiment of another package, found by its entry point alone; and one that is broken.

The package `spin_down` next to this file is the worked example of docs/how-to/add-an-experiment.md.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from motord.config import packaged
from motord.results.store import ResultsStore

HERE = Path(__file__).parent
Run = Callable[..., "subprocess.CompletedProcess[str]"]


def announce(folder: Path, package: str, **experiments: str) -> None:
    """Write what `pip install` writes of a package whose pyproject.toml has these entry points."""
    info = folder / f"{package}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    lines = [f"{name} = {value}" for name, value in experiments.items()]
    (info / "entry_points.txt").write_text("[motord.experiments]\n" + "\n".join(lines) + "\n")


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Return what runs Python with both packages installed, in a folder of its own."""
    installed = tmp_path / "installed"
    announce(installed, "spin-down", spin_down="spin_down:EXPERIMENT")
    announce(installed, "broken", broken="broken_experiment:EXPERIMENT")
    (installed / "broken_experiment.py").write_text("raise RuntimeError('no such device')\n")
    paths = [str(installed), str(HERE), *filter(None, sys.path)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "COLUMNS": "200"}

    def run(*arguments: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [sys.executable, *arguments], cwd=tmp_path, env=environment, check=False,
            capture_output=True, text=True, timeout=300,
        )  # fmt: skip

    return run


def bench_file(path: Path, plans: str) -> Path:
    text = packaged("sim.toml").read_text()
    rig = packaged("report.rig.toml")
    path.write_text(text.replace('"report.rig.toml"', f'"{rig}"') + plans)
    return path


def test_it_is_listed_with_its_section_and_the_broken_one_is_left_out_and_named(
    run: Run, tmp_path: Path
) -> None:
    good = bench_file(tmp_path / "good.toml", "\n[plans.spin-down]\ntorque_Nm = 1.5\n")
    wrong = bench_file(tmp_path / "wrong.toml", "\n[plans.spin-down]\ntorque = 1.5\n")
    done = run(
        "-c",
        "import json, sys\n"
        "from pathlib import Path\n"
        "from motord.config import load\n"
        "from motord.config.experiments import analysis_kinds, broken_experiments, plan_kinds\n"
        "torque_Nm = load(Path(sys.argv[1])).plans.spin_down.torque_Nm\n"
        "print(json.dumps([list(plan_kinds()), list(analysis_kinds()), "
        "list(broken_experiments()), torque_Nm]))\n"
        "load(Path(sys.argv[2]))",
        str(good),
        str(wrong),
    )
    assert done.returncode == 1
    assert "plans.spin-down.torque" in done.stderr
    plans, analyses, broken, torque_Nm = json.loads(done.stdout)
    assert "spin-down" in plans
    assert "calibrate" in plans
    assert "spin-down" in analyses
    assert broken == [
        "experiment broken cannot be imported: broken_experiment:EXPERIMENT: "
        "RuntimeError: no such device"
    ]
    assert torque_Nm == 1.5


def test_it_is_simulated_and_analysed(run: Run, tmp_path: Path) -> None:
    bench = bench_file(tmp_path / "bench.toml", "\n[plans.spin-down]\naccelerate_s = 0.1\n")
    done = run("-m", "motord", "simulate", "spin-down", "-c", str(bench), "-o", "a.mcap")
    assert done.returncode == 0, done.stderr
    done = run(
        "-m", "motord", "analyse", "spin-down", "a.mcap",
        "--json", "--report", "a.html", "--store", "store",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr.startswith("stored ")
    rows = ResultsStore(tmp_path / "store").read().table.to_pylist()
    assert {(row["experiment"], row["field"].split(".")[0], row["unit"]) for row in rows} == {
        ("spin-down", "time_s", "s"),
        ("spin-down", "turns", ""),
    }
    found = json.loads(done.stdout)
    assert found["schema"] == "spin-down/1"
    assert found["turns"][0] > 1
    assert "Spin-down" in (tmp_path / "a.html").read_text()


def test_the_list_of_analyses_has_its_help_and_names_the_broken_one(run: Run) -> None:
    done = run("-m", "motord", "analyse", "--help")
    assert "spin-down" in done.stdout
    assert "Find how long the rotor turns on." in done.stdout
    assert "experiment broken cannot be imported" in " ".join(done.stdout.split())


def test_a_plan_that_is_not_there_names_those_that_are_and_the_broken_one(run: Run) -> None:
    done = run("-m", "motord", "simulate", "spin-up")
    assert done.returncode == 1
    assert "spin-down" in done.stderr
    assert "experiment broken cannot be imported" in done.stderr
