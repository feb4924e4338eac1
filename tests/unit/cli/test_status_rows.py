"""`motord status`: what to do about a loop that has ended or hangs, and a trip that outlives it."""

import pytest

from motord.api.descriptions import LOOP_SILENT, LOOP_STUCK
from motord.api.messages import ProcessView
from motord.cli.bench.status import table
from tests.unit.cli.watch.samples import TRIP, state


def rows(**changes):
    columns = (list(column.cells) for column in table(state(**changes)).columns)
    return list(zip(*columns, strict=True))


def loop(*, running):
    return {"loop": ProcessView(pid=7 if running else None, running=running, restarts=0, exit="")}


@pytest.mark.parametrize(
    ("fault", "running", "remedy"),
    [
        ("the loop ended: killed by SIGKILL", False, ["`motord reset` starts the loop again"]),
        (LOOP_SILENT, True, ["`motord reset` ends it and starts it again"]),
        (LOOP_STUCK, True, ["`motord reset` ends it and starts it again"]),
        ("brake has not answered for 1 s: its driver does not return", True, []),
        ("", True, []),
    ],
)
def test_what_to_do_about_the_loop(fault, running, remedy):
    shown = rows(fault=fault, processes=loop(running=running))
    assert [text for name, text in shown if name == "then"] == remedy


def test_a_trip_that_outlives_the_loop_is_shown_with_what_to_do():
    fault = "the loop ended: killed by SIGKILL"
    shown = dict(rows(**TRIP, fault=fault, tick=None, processes=loop(running=False)))
    assert (shown["state"], shown["fault"]) == ("TRIPPED", fault)
    assert shown["suggested"].startswith("check that the brake answers")
