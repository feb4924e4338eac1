"""The client for asyncio: against the daemon's own pieces, and what a cancellation leaves."""

import asyncio
import threading

import numpy as np
import pytest

from motord.client import Client, ClientError, Lease, PlanEndedError, aio
from motord.client.aio import AsyncSubscription
from motord.client.aio.threads import Threads
from motord.client.subscription import Subscription, TickLosses
from tests.support.patience import PATIENCE_S

LONG = {"torques_Nm": [1.0], "speeds_Hz": [1.0], "turns": 1000, "gain_steps": []}
"""Over only when it is aborted."""


def run(live, use):
    """Run `use(client)` with a client of the bench."""

    async def main():
        async with asyncio.timeout(3 * PATIENCE_S), aio.connect("live", live.listen) as client:
            await use(client)

    asyncio.run(main())


def test_it_is_used_as_the_one_for_threads(live):
    async def use(client):
        assert (await client.stop("a test")).state == "OFF"
        async with client.lease("anna") as lease, client.subscribe_state() as states:
            first = await states.get(0.0)
            assert first is not None
            assert first.bench == client.bench == "live"
            assert (await lease.enable()).state == "ENABLED"
            reply = await lease.set(torque_Nm=0.5, speed_Hz=0.5)
            assert reply.setpoint.torque_target_Nm == 0.5
            async for state in states:
                if state.setpoint.torque_target_Nm == 0.5:
                    break
            assert (await client.rpc("disable", token=lease.token))["state"] == "READY"
        async with client.subscribe_state() as states:
            async for state in states:  # what is shown is some tenths of a second old
                if state.lease.holder is None:
                    break
        with pytest.raises(ClientError, match="turns"):
            await client.dry_run("calibrate", {"turns": 0})

    run(live, use)


def test_ticks_come_without_a_gap_and_the_iterator_ends_the_subscription(live):
    async def use(client):
        ticks, blocks = client.subscribe_ticks(), []
        async for block in ticks:
            blocks.append(block)
            if len(blocks) == 2:
                break
        assert np.all(np.diff(np.concatenate(blocks)["tick"].astype(int)) == 1)
        assert ticks.losses == TickLosses()
        async with asyncio.timeout(PATIENCE_S):
            while not ticks._sync._closed:
                await asyncio.sleep(0)

    run(live, use)


def test_a_plan_is_followed_to_its_end(live):
    async def use(client):
        await client.stop()
        async with client.lease("anna") as lease:
            plan, steps = lease.run_plan("calibrate", LONG), 0

            async def abort_after_a_while():
                nonlocal steps
                async for progress in plan:
                    assert progress.plan == "calibrate"
                    steps += 1
                    if steps == 2:
                        await lease.abort_plan()

            with pytest.raises(PlanEndedError, match="aborted by anna"):
                await abort_after_a_while()
            with pytest.raises(PlanEndedError):
                await client.follow_plan().wait()

    run(live, use)


def test_a_cancelled_task_gives_its_lease_back(live):
    async def use(client):
        commands = asyncio.Event()

        async def operate():
            async with client.lease("anna") as lease:
                await lease.reset()
                commands.set()
                async for _ in client.subscribe_ticks():
                    pass

        task = asyncio.create_task(operate())
        await commands.wait()
        assert (await client.state()).lease.holder == "anna"
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        async with client.subscribe_state() as states:
            async for state in states:
                if state.lease.holder is None:
                    break

    run(live, use)


def test_a_lease_that_is_taken_over_is_noticed(live):
    async def use(client):
        async with client.lease("anna") as lease, client.lease("ben", force=True):
            async with asyncio.timeout(PATIENCE_S):
                await lease.lost.wait()
            assert "ben took over" in lease.why

    run(live, use)


class Gate:
    """A function that waits in its thread until it is opened."""

    def __init__(self):
        self.entered, self.opened, self.left = threading.Event(), threading.Event(), []

    def enter(self):
        self.entered.set()
        assert self.opened.wait(PATIENCE_S)
        return "entered"


def test_what_is_granted_to_a_cancelled_task_is_given_back():
    gate = Gate()

    async def main():
        threads = Threads()
        task = asyncio.create_task(threads.enter(gate.enter, gate.left.append))
        await threads.finish(gate.entered.wait)
        for _ in range(2):
            task.cancel()
            await asyncio.sleep(0)
        assert not task.done()
        gate.opened.set()
        with pytest.raises(asyncio.CancelledError):
            await task
        threads.end()

    asyncio.run(main())
    assert gate.left == ["entered"]


def test_an_event_loop_that_hangs_is_not_filled_with_calls(session):
    async def main():
        threads, calls = Threads(), []
        async with AsyncSubscription(
            threads, lambda: Subscription(session, "key", int, kept=3)
        ) as numbers:
            loop = asyncio.get_running_loop()
            call_soon = loop.call_soon_threadsafe
            loop.call_soon_threadsafe = lambda *call: calls.append(call) or call_soon(*call)
            for number in range(1000):
                session.sends(b"%d" % number)  # the event loop does not run meanwhile
            assert len(calls) == 1
            loop.call_soon_threadsafe = call_soon
            assert [await numbers.get(0.0) for _ in range(4)] == [997, 998, 999, None]
            assert (numbers.lost, numbers.malformed) == (997, 0)
            waiting = asyncio.create_task(numbers.get())
            await asyncio.sleep(0)
            session.sends(b"7")
            assert await waiting == 7
        assert await numbers.get() is None
        threads.end()

    asyncio.run(main())


def test_it_has_what_the_client_for_threads_has():
    def names(of):
        return {name for name in dir(of) if not name.startswith("_")}

    missing = names(Client) - names(aio.AsyncClient)
    assert missing <= {"ask", "call", "close", "endpoint", "identity"}
    assert names(Lease) - names(aio.AsyncLease) <= {"acquire", "release"}


def test_notes_and_the_mesh_are_awaited(live):
    async def use(client):
        assert (await client.note("it squeals")).recording == ""
        mesh = await client.mesh()
        assert mesh is None or mesh.points
        async with client.subscribe_mesh() as meshes:
            assert await meshes.get(0.0) is None

    run(live, use)


def test_a_client_outside_of_its_block_says_so():
    with pytest.raises(RuntimeError, match="async with"):
        aio.connect("live", "tcp/127.0.0.1:1").bench  # noqa: B018


def test_nobody_there_is_said():
    async def main():
        async with aio.connect("x", "tcp/127.0.0.1:9"):
            pass

    with pytest.raises(ClientError, match="no motord at"):
        asyncio.run(main())
