"""What a command prints to be typed or pasted works for any path."""

import json
import shlex
import tomllib

from typer.testing import CliRunner

from motord.cli import app


def printed(*arguments: str) -> tuple[str, str]:
    done = CliRunner().invoke(app, list(arguments))
    assert done.exit_code == 0, done.output
    return done.stdout, done.stderr


def test_the_next_steps_of_a_bench_file(tmp_path):
    file = str(tmp_path / "my bench.toml")
    made, _ = printed("new", file, "--template", "simulated", "--yes", "--json")
    steps = json.loads(made)["next"]
    assert all(file in shlex.split(step, comments=True) for step in steps)


def test_the_section_and_the_next_step_of_an_authority(tmp_path):
    folder = tmp_path / 'the "new" \\ lab'
    section, remark = printed("security", "init", str(folder))
    assert tomllib.loads(section)["zenoh"]["tls"]["ca"] == str(folder / "ca.pem")
    assert shlex.split(remark)[-1] == str(folder)
