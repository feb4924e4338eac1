"""Which daemon `motord archive` asks whether the bench is idle."""

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from motord.cli import app
from motord.cli.record import archiving
from motord.config import load

CONFIG = Path(__file__).parents[3] / "config" / "emulated.toml"
ELSEWHERE = "tcp/127.0.0.1:1"


@pytest.mark.parametrize(
    ("words", "endpoint"),
    [
        ([], ELSEWHERE),
        (["-c", str(CONFIG)], None),
        (["-c", str(CONFIG), "--connect", "tcp/127.0.0.1:2"], "tcp/127.0.0.1:2"),
    ],
)
def test_a_bench_file_counts_more_than_the_environment(tmp_path, monkeypatch, words, endpoint):
    asked = []

    def note(connection):
        asked.append(connection.endpoint)
        raise typer.Exit(0)

    monkeypatch.setattr(archiving, "_idleness", note)
    monkeypatch.setenv("MOTORD_CONNECT", ELSEWHERE)
    command = ["archive", str(tmp_path), "--from", str(tmp_path), *words]
    assert CliRunner().invoke(app, command).exit_code == 0
    assert asked == [endpoint or load(CONFIG).zenoh.local[0]]
