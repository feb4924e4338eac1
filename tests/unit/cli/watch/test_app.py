"""The screen on a terminal of 80 x 24: keys, and what becomes of them."""

import asyncio
import threading
from contextlib import asynccontextmanager
from types import SimpleNamespace

import pytest

from motord.cli.bench.watch import operator_session
from motord.cli.bench.watch.feed import Feed
from motord.cli.bench.watch.glyphs import UNICODE
from motord.cli.bench.watch.keys import ACTIONS, KEYS
from motord.cli.bench.watch.operator_session import OperatorSession
from motord.client import ClientError
from tests.support.patience import PATIENCE_S
from tests.unit.cli.watch.samples import NOW_NS, PLAN, TRIP, FakeClient, state, ticks

NOBODY = {"holder": None, "remaining_s": 0.0, "duration_s": 2.0}
UNANSWERED_S = 2 * PATIENCE_S
"""A stop is late once a test says so, and not for a computer that stalls."""


class Watched:
    """The screen, and the daemon that it shows."""

    def __init__(self, client, app, pilot, clock):
        self.client, self.app, self.pilot, self.clock = client, app, pilot, clock

    async def press(self, *keys):
        await self.pilot.press(*keys)
        await self.pilot.pause()

    async def publish(self, **changes):
        self.client.publish_state(state(**changes))
        self.app.draw()
        await self.pilot.pause()

    @property
    def lines(self):
        """What is on the screen, cell by cell, as the terminal gets it."""
        strips = self.app.screen._compositor.render_strips()
        return ["".join(segment.text for segment in strip) for strip in strips]

    async def sees(self, words):
        """Wait until there are these words on the screen."""
        end_s = asyncio.get_running_loop().time() + PATIENCE_S
        while not any(words in line for line in self.lines):
            assert asyncio.get_running_loop().time() < end_s, "\n".join([words, *self.lines])
            self.app.draw()
            await self.pilot.pause(0.01)

    async def asks(self, name, times=1):
        """Wait until something was asked so often, and return what was asked last."""
        end_s = asyncio.get_running_loop().time() + PATIENCE_S
        while len(self.client.asked(name)) < times:
            assert asyncio.get_running_loop().time() < end_s, self.client.requests
            await self.pilot.pause(0.01)
        return self.client.asked(name)[-1]


@pytest.fixture(autouse=True)
def private(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(operator_session, "UNANSWERED_S", UNANSWERED_S)


@asynccontextmanager
async def watching(client, size=(80, 24), **changes):
    from motord.cli.bench.watch.app import WatchApp  # 0.2 s, of whoever collects

    clock = SimpleNamespace(now_s=0.0)
    session = OperatorSession(client)
    try:
        with Feed(client, lambda: clock.now_s) as feed:
            client.publish_state(state(**changes))
            app = WatchApp(feed, session, UNICODE)
            async with app.run_test(size=size) as pilot:
                watched = Watched(client, app, pilot, clock)
                await watched.publish(**changes)
                yield watched
    finally:
        session.give()


def scenario(function):
    """Make an ordinary test of one that waits."""

    def test():
        asyncio.run(function(FakeClient()))

    test.__name__, test.__doc__ = function.__name__, function.__doc__
    return test


@scenario
async def test_the_state_of_the_daemon_is_on_the_screen(client):
    async with watching(client, plan=PLAN) as watched:
        assert len(watched.lines) == 24
        assert {len(line) for line in watched.lines} == {80}
        for words in ("● ENABLED", "3.013 Nm", "calibrate running", "OFF -> READY"):
            await watched.sees(words)
        await watched.publish(state="OFF")
        assert "○ OFF" in watched.lines[1]


@pytest.mark.parametrize("key", sorted(key for key, action in ACTIONS.items() if action == "stop"))
def test_each_stop_key_stops_without_a_lease_and_shows_off_only_once_it_is(key):
    async def stop():
        answered, client = threading.Event(), FakeClient()
        client.replies["stop"] = lambda: answered.wait(PATIENCE_S) and {"state": "OFF"}
        async with watching(client) as watched:
            await watched.press(key)
            assert "by" in await watched.asks("stop")
            await watched.sees("stopping...")
            assert "● ENABLED" in watched.lines[1]  # what the daemon says, not what was pressed
            answered.set()
            await watched.publish(state="ENABLED")
            await watched.sees("stopping...")
            await watched.publish(state="OFF")
            await watched.sees("stopped: the daemon says OFF")
            assert "stopping" not in watched.lines[1]
        assert [name for name, _ in client.requests if name != "config"] == ["stop"]

    asyncio.run(stop())


@scenario
async def test_a_stop_that_fails_or_is_not_answered_says_so(client):
    client.replies["stop"] = ClientError("unreachable", "the daemon is gone")
    async with watching(client) as watched:
        await watched.press("s")
        await watched.sees("stop FAILED: the daemon is gone; use the emergency stop")
        watched.app._controls._stopping._asked_s -= UNANSWERED_S + 1.0
        await watched.sees("stop NOT confirmed")


@scenario
async def test_a_stop_without_an_answer_says_so(client):
    never = threading.Event()
    client.replies["stop"] = lambda: never.wait(PATIENCE_S) and {"state": "OFF"}
    async with watching(client) as watched:
        await watched.press("s")
        watched.app._controls._stopping._asked_s -= UNANSWERED_S + 1.0
        await watched.sees("the daemon has not confirmed the stop: use the emergency stop")
        never.set()


@scenario
async def test_escape_stops_in_every_dialog_and_closes_it(client):
    async with watching(client, plan=PLAN) as watched:
        for times, dialog in enumerate(("question_mark", "a", "t", "n", "l"), start=1):
            await watched.press(dialog)
            assert watched.app._controls.dialog is not None, dialog
            await watched.press("escape")
            await watched.asks("stop", times)
            assert watched.app._controls.dialog is None, dialog


@scenario
async def test_letters_stop_while_a_torque_is_typed(client):
    async with watching(client) as watched:
        for times, key in enumerate(("s", "S", "space"), start=1):
            await watched.press("t", "2", key)
            await watched.asks("stop", times)
            assert not client.asked("set")


@scenario
async def test_a_stop_does_not_wait_for_another_command(client):
    client.replies["enable"] = lambda: never.wait(PATIENCE_S) and {"state": "ENABLED"}
    never = threading.Event()
    async with watching(client, state="READY") as watched:
        await watched.press("e")
        await watched.asks("enable")
        await watched.press("d")
        await watched.sees("not done: disable; still waiting for: enable")
        await watched.press("s")
        await watched.asks("stop")
        never.set()


@scenario
async def test_a_plan_is_paused_and_resumed_with_a_lease_for_that_alone(client):
    async with watching(client, plan=PLAN) as watched:
        await watched.press("p")
        await watched.sees("calibrate: pausing")
        assert client.asked("plan/pause") == [{"token": "t0"}]
        assert len(client.asked("lease/release")) == 1
        await watched.publish(plan={**PLAN, "state": "paused"})
        await watched.press("p")
        await watched.sees("calibrate: running")
        await watched.publish(plan={**PLAN, "state": "done"})
        await watched.press("p")
        await watched.sees("no plan is under way")


@scenario
async def test_an_abort_asks_first(client):
    async with watching(client, plan=PLAN) as watched:
        await watched.press("a")
        await watched.sees("Abort calibrate?")
        await watched.press("n")
        assert not client.asked("plan/abort")
        await watched.press("a", "y")
        await watched.asks("plan/abort")
        await watched.sees("calibrate: ending")


@scenario
async def test_a_note_may_hold_any_text(client):
    async with watching(client) as watched:
        await watched.press("n", *"squeal", "space", "s", "enter")
        assert (await watched.asks("note"))["text"] == "squeal s"
        await watched.sees("noted in /runs/r.mcap")
        await watched.press("n", "enter")
        assert len(client.asked("note")) == 1
        assert not client.asked("stop")


@scenario
async def test_enable_keeps_the_lease_and_quitting_asks_then(client):
    async with watching(client, state="READY", lease=NOBODY) as watched:
        await watched.press("e")
        await watched.sees("lease: held here")
        await watched.publish(state="ENABLED")
        await watched.press("q")
        await watched.sees("the bench ramps down. Quit?")
        await watched.press("n")
        assert watched.app.is_running
        await watched.press("q", "y")
    assert len(client.asked("lease/release")) == 1


@scenario
async def test_without_the_lease_it_quits_at_once(client):
    async with watching(client) as watched:
        await watched.press("q")
        assert watched.app._exit


@scenario
async def test_a_torque_is_a_number(client):
    setpoint = {"torque_target_Nm": -1.5, "speed_Hz": None, "brake": 0.0, "drive_Hz": 0.0}
    setpoint |= {"torque_Nm": 0.0, "compensate": "on"}
    client.replies["set"] = {"setpoint": setpoint, "reached_in_s": 0.3, "state": "ENABLED"}
    async with watching(client) as watched:
        await watched.press("t", *"1..5", "enter")
        await watched.sees("'1..5' is no torque in Nm: nothing is set")
        await watched.press("t", *"-1,5", "enter")
        assert (await watched.asks("set"))["torque_Nm"] == -1.5
        await watched.sees("set: torque -1.5 Nm, reached in 0.3 s")


@scenario
async def test_who_has_the_lease_is_said_and_it_is_taken_over_only_if_confirmed(client):
    grant = client.replies["lease/acquire"]
    client.replies["lease/acquire"] = ClientError("lease_held", "bob pts/1 7 is in command, for")
    async with watching(client) as watched:
        await watched.press("r")
        await watched.sees("reset: bob pts/1 7 has the lease; l takes it over")
        client.replies["lease/acquire"] = grant
        await watched.press("l")
        await watched.sees("anna@bench pts/3 4711 has the lease. Take it over?")
        await watched.press("x")
        assert client.asked("lease/acquire")[-1]["force"] is False
        await watched.press("l", "y")
        await watched.sees("the lease is held here")
        await watched.sees("lease: held here")
        assert client.asked("lease/acquire")[-1]["force"] is True
        await watched.press("l", "y")
        await watched.sees("the lease was given back")


@scenario
async def test_a_lost_lease_is_shown(client):
    async with watching(client, lease=NOBODY) as watched:
        await watched.press("l")
        await watched.sees("the lease is held here")
        await watched.sees("lease: held here")
        watched.app._session._lease._lose("bob took over command")
        await watched.sees("the lease is lost: bob took over command")
        assert "held here" not in watched.lines[1]


@scenario
async def test_a_viewer_sees_why_nothing_is_done(client):
    client.identity = SimpleNamespace(name="vera", role="viewer")
    async with watching(client, plan=PLAN) as watched:
        for key in ("s", "p", "n", "t", "e"):
            await watched.press(key)
            await watched.sees("vera is a viewer and may only watch")
            watched.app._controls._say("")
        await watched.sees("vera: may only watch")
        await watched.press("s")
        await watched.sees("may only watch: an operator's identity")
        [alarm] = watched.app.screen._compositor.render_strips()[-2:-1]
        assert [str(segment.style.bgcolor) for segment in alarm if segment.text.strip()]
        assert all("red" in str(s.style.bgcolor) for s in alarm if s.text.strip())
    assert {name for name, _ in client.requests} <= {"config"}


@scenario
async def test_a_silent_daemon_is_shown_and_its_events_are_fetched_when_it_is_back(client):
    async with watching(client) as watched:
        watched.clock.now_s = 3.0
        await watched.sees("NO DATA for 3 s")
        client.remembered = [state_event("the loop ended")]
        await watched.publish()
        await watched.sees("the loop ended")
        assert not any("NO DATA" in line for line in watched.lines)


def state_event(message):
    from motord.api.messages import Event

    return Event(t_ns=NOW_NS, kind="fault", message=message)


@scenario
async def test_it_follows_the_size_of_the_terminal(client):
    async with watching(client) as watched:
        client.publish_ticks(ticks(10.0, 2.0))
        for size in ((120, 40), (60, 15), (80, 24)):
            await watched.pilot.resize_terminal(*size)
            await watched.publish(**TRIP)
            await watched.sees("✕ TRIPPED")
            assert len(watched.lines) == size[1]


@scenario
async def test_events_scroll_by_the_arrows(client):
    async with watching(client) as watched:
        for number in range(50):
            client.publish_event(state_event(f"number {number}."))
        await watched.sees("number 49.")
        await watched.press(*["up"] * 20)
        await watched.sees("number 29.")
        await watched.press("end")
        await watched.sees("number 49.")


@scenario
async def test_what_fails_in_a_command_does_not_end_the_screen(client):
    client.replies["reset"] = ValueError("an error in the program")
    async with watching(client) as watched:
        await watched.press("r")
        await watched.sees("reset: an error in the program")


@scenario
async def test_the_help_has_every_key(client):
    async with watching(client) as watched:
        await watched.press("question_mark")
        for key in KEYS:
            await watched.sees(key.meaning)
        await watched.press("x")
        assert watched.app._controls.dialog is None
