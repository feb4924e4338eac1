"""Daemons behind routers: one is killed, a router is stopped; the others go on."""

import subprocess
import sys
from contextlib import ExitStack, closing

import pytest

from motord.client import connect
from tests.support.patience import PATIENCE_S, until
from tests.system.daemons import wait_for
from tests.system.many_benches import (
    RouterProcess,
    Sightings,
    archived,
    endpoint,
    kill_supervisor,
    running,
    start_plan,
)

pytestmark = [pytest.mark.system, pytest.mark.long]


def lines_of(*words):
    done = subprocess.run(
        [sys.executable, "-m", "motord", *words], capture_output=True, text=True,
        timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    return done.stdout.splitlines(), done.returncode


def test_a_killed_daemon_and_a_stopped_router_leave_the_others(tmp_path):
    """`lost` is killed in mid-plan, then the router in front of it and of `near` is stopped."""
    lost, near, far = "lost", "near", "far"
    folder = tmp_path
    with running(folder, (lost, near, far)) as daemons, ExitStack() as stack:
        one = RouterProcess(endpoint(), *(daemons[name].endpoint for name in (lost, near)))
        stack.callback(one.close)
        other = RouterProcess(endpoint(), daemons[far].endpoint, one.listen)
        stack.callback(other.close)
        seen = stack.enter_context(closing(Sightings(one.listen, other.listen)))
        for name in daemons:
            seen.since(0.0, name, True)
        clients = {name: stack.enter_context(p.connect()) for name, p in daemons.items()}
        through = stack.enter_context(connect(far, other.listen))
        for client in clients.values():
            start_plan(client)
        wait_for(clients[lost], lambda s: s.plan and s.plan.points_done >= 1, "a point")
        begun_s = kill_supervisor(daemons[lost])
        seen.since(begun_s, lost, False)
        lines, code = lines_of("status", "--all", "--connect", other.listen)
        assert (code, sorted(line.split()[0] for line in lines)) == (0, sorted((near, far)))
        begun_s = one.close()
        seen.since(begun_s, near, False)
        for name in (near, far):
            done = wait_for(clients[name], lambda s: s.plan and s.plan.over, "the plan's end")
            assert (done.plan.state, done.plan.points_done) == ("done", 4)
        until(lambda: seen.there() == {far}, "no more than one bench to be there")
        unclosed = (folder / lost / "runs").glob
        until(lambda: not [*unclosed("*.part")], "the recorder of the killed daemon")
        with through.subscribe_ticks() as ticks:
            assert ticks.get(PATIENCE_S) is not None
        again = RouterProcess(one.listen, *one.connect)
        stack.callback(again.close)
        seen.since(begun_s, near, True)
        for name in (near, far, lost):
            copied, report, verified = archived(
                folder / name, folder / f"{name}-archive", daemons[name].endpoint
            )
            assert copied
            assert (report["conflicts"], verified["differing"]) == ({}, {})
            whole = {p.name for p in (folder / name / "runs").glob("*.mcap")}
            assert {p.name for p in (folder / f"{name}-archive").glob("*.mcap")} == whole
