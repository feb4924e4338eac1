"""What to do about a loop that has ended or hangs, wherever a state is shown; and about a trip.

And a recording that may not go on.
"""

from contextlib import nullcontext
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from motord.api.descriptions import HANGING_REMEDY, LOOP_SILENT
from motord.api.messages import Event
from motord.cli import app
from motord.cli.bench import overview, wording
from motord.cli.bench.status import show, table
from motord.cli.bench.watch import command
from motord.cli.connection_options import Connection
from motord.client.roster import BenchEntry
from motord.dashboard.overview.bench_list import described
from tests.unit.cli.watch.samples import TRIP, state

SILENT = {"state": "OFF", "fault": LOOP_SILENT, "remedy": HANGING_REMEDY}


def rows(**changes):
    columns = (list(column.cells) for column in table(state(**changes)).columns)
    return list(zip(*columns, strict=True))


def entry(**changes):
    return BenchEntry("a", state(**changes), 0.1, True, 1, "", "tcp/127.0.0.1:7447")


def test_into_a_pipe_each_row_is_a_line_that_nothing_is_added_to(capsys):
    long = {**TRIP, "fault": "x" * 600, "remedy": ""}
    show(state(**long))
    lines = capsys.readouterr().out.splitlines()
    assert lines == [line.rstrip() for line in lines]
    assert len(lines) == len(rows(**long))
    assert any(line.split(maxsplit=1) == ["fault", "x" * 600] for line in lines)


@pytest.mark.parametrize(("changes", "shown"), [(SILENT, [HANGING_REMEDY]), ({}, [])])
def test_status_has_the_remedy_on_a_line_of_its_own(changes, shown):
    assert [text for name, text in rows(**changes) if name == "then"] == shown


@pytest.mark.parametrize(
    "shown",
    [
        lambda: command.in_one_line(state(**SILENT)),
        lambda: overview.in_one_line(entry(**SILENT)),
        lambda: str(described(entry(**SILENT))["state"]),
    ],
)
def test_a_line_and_the_overview_have_it_too(shown):
    text = shown()
    assert LOOP_SILENT in text
    assert HANGING_REMEDY in text


def test_a_recording_that_may_not_go_on_is_shown_as_one():
    silent = {"recording": True, "path": "/runs/a.mcap.part", "error": "no report for 8 s"}
    assert ("recording", "/runs/a.mcap.part: no report for 8 s") in rows(recording=silent)
    line = overview.in_one_line(entry(recording=silent))
    assert "recording a.mcap.part: no report for 8 s" in line


def test_a_trip_that_outlives_the_loop_is_shown_with_what_to_do():
    fault = "the loop ended: killed by SIGKILL"
    shown = dict(rows(**TRIP, fault=fault, tick=None))
    assert (shown["state"], shown["fault"]) == ("TRIPPED", fault)
    assert shown["suggested"].startswith("check that the brake answers")


@pytest.mark.parametrize(("tau_s", "said"), [(0.0, False), (1.0, True)])
def test_a_line_says_that_the_torque_is_without_its_mean(tau_s, said):
    sensor = state().torque_sensor.model_copy(update={"highpass_time_constant_s": tau_s})
    line = command.in_one_line(state().model_copy(update={"torque_sensor": sensor}))
    assert ("without its mean" in line) == said


@pytest.mark.parametrize(
    ("value", "shown"),
    [(None, "-"), (1e-7, "0"), (0.12345, "0.123"), (-99.96, "-100"), (1523.4, "1523")],
)
def test_numbers_have_three_digits_and_no_exponent(value, shown):
    assert wording.number(value) == shown


def test_events_are_shown_once_each_also_after_a_clock_was_set_back(monkeypatch):
    old, new = (Event(t_ns=t_ns, kind="note", message=f"at {t_ns}") for t_ns in (2000, 1000))
    coming = iter([old, new])

    def get(timeout_s):
        try:
            return next(coming)
        except StopIteration:
            raise KeyboardInterrupt from None

    client = SimpleNamespace(
        events=lambda: [old], subscribe_events=lambda: nullcontext(SimpleNamespace(get=get))
    )
    monkeypatch.setattr(Connection, "connect", lambda self: nullcontext(client))
    shown = CliRunner().invoke(app, ["events", "--json"]).stdout.splitlines()
    assert [Event.model_validate_json(line) for line in shown] == [old, new]
