"""What `motord plan` says at the end of a plan."""

from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.cli.plan.commands import _then


@pytest.mark.parametrize(
    ("plan", "expected"),
    [
        ("verify", "\nnext: motord analyse verify run.mcap"),
        ("learn", "\nnext: motord analyse learn run.mcap --calibration 'in force.json'"),
        (
            "check-calibration",
            "\nnext: motord analyse check-calibration run.mcap --calibration 'in force.json'",
        ),
    ],
)
def test_the_next_command_names_the_calibration_where_it_needs_it(plan: str, expected: str) -> None:
    force = SimpleNamespace(path="in force.json")
    client = SimpleNamespace(state=lambda: SimpleNamespace(calibration=force))
    view = SimpleNamespace(over=True, points_done=3, recording="run.mcap", continues="", plan=plan)
    assert _then(client, view) == expected


@pytest.mark.parametrize("option", ["--wait-limit-s", "--retries"])
def test_an_option_of_the_queue_that_would_do_nothing_is_refused(option: str) -> None:
    result = CliRunner().invoke(app, ["queue", "add", "verify", option, "5"])
    assert result.exit_code == 2
    assert option in result.output
