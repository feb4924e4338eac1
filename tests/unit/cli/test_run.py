"""`motord run`: which bench it runs is said before it runs."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.config import packaged
from motord.service import daemon

SIMULATED = "no bench file (-c FILE): this is the packaged simulated bench"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [([], True), (["--json"], False), (["-c", str(packaged("sim.toml"))], False)],
)
def test_without_a_bench_file_it_says_that_the_bench_is_simulated(
    monkeypatch: pytest.MonkeyPatch, arguments: list[str], said: bool
) -> None:
    begun: list[Path] = []
    monkeypatch.setattr(daemon, "run", lambda path, ready: begun.append(path))
    done = CliRunner().invoke(app, ["run", *arguments])
    assert (done.exit_code, begun) == (0, [packaged("sim.toml")])
    assert (SIMULATED in done.stderr) is said
