"""A daemon that is none: the page's server with made-up ticks, plans and mishaps.

`python -m tests.browser.stand_in` serves it and prints its address. A test calls the methods that
begin a mishap from its own thread (`StandIn.do`).
"""

import asyncio
import sys
import threading
import time
from collections.abc import Awaitable, Callable
from typing import Any, Self

import uvicorn
from starlette.applications import Starlette

from motord import config
from motord.api.messages import BenchState, Event
from motord.api.plan_messages import MeshView, PlanView
from motord.client import ClientError
from motord.dashboard.app import application
from motord.dashboard.bench_link import SILENT_S, Connectivity, Item
from motord.dashboard.live_bench import LiveBench
from motord.dashboard.page.pages import Pages
from motord.dashboard.server import listen, urls
from motord.dashboard.tokens import Tokens
from motord.schema import State, Trip
from motord.security.roles import Role
from tests.browser import documents
from tests.browser.stand_in_queue import StandInQueue
from tests.browser.synthetic_bench import CALIBRATED, SyntheticBench

BLOCK_S = STATE_S = 0.1
"""Seldom for ticks: the page draws each block of them, which takes most of a browser's time."""
LEASE_S = 20.0
"""Long: the browser and this process share a busy computer."""


class StandIn:
    """The daemon's side: answers requests, publishes state, plan, mesh and ticks."""

    def __init__(self, rate_Hz: float = 1000.0) -> None:
        self.config = config.load(config.packaged("sim.toml")).model_dump(mode="json")
        self.config["loop"]["rate_Hz"] = rate_Hz
        self.bench = SyntheticBench(rate_Hz)
        self.holder: str | None = None
        self.token = ""
        self.silent = self.loop_ended = self.ticks_withheld = False
        self.why_silent = "the daemon publishes nothing"
        self.barred = self.unreported = ""
        self.unanswered: set[str] = set()
        self.trip: dict[str, Any] | None = None
        self.tracking: dict[str, Any] | None = None
        self.events_so_far: list[Event] = []
        self.plan: PlanView | None = None
        self.mesh: MeshView | None = None
        self.queue = StandInQueue(lambda message: self.event("queue", message))
        self.requests: list[tuple[str, dict[str, Any]]] = []
        self.plans = documents.plans()
        self.calibrations = documents.calibrations()
        self.held_back: set[str] = set()
        """Calibrations that are shown only when they are no longer in here."""
        self.waited_for: list[str] = []
        """Those that were asked for meanwhile."""
        self.given_late: list[str] = []
        self.points_per_s = 10.0
        self.points_max = 6
        """A plan takes no more points, and goes on with the next for ever: one of more points ends
        by what a test does alone."""
        self._lease_until_s = 0.0
        self._started_s = time.monotonic()
        self._received_s = time.monotonic()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._take: Callable[[list[Item]], None] = lambda items: None
        self._due_s = time.monotonic()
        self._plan_s = 0.0

    # what the server asks of its link to the daemon

    def start(self, take: Callable[[list[Item]], None]) -> None:
        """Publish to `take`."""
        self._loop = asyncio.get_running_loop()
        self._take = take
        self.event("daemon", "the stand-in began")

    async def keep(self, connected: Callable[[], Awaitable[None]]) -> None:
        """Publish for ever."""
        self.connected = connected
        while True:
            await asyncio.sleep(BLOCK_S)
            self._step(time.monotonic())

    async def call(self, name: str, /, *, urgent: bool = False, **arguments: Any) -> dict[str, Any]:
        """Answer a request. Raises ClientError."""
        self.requests.append((name, arguments))
        if self.silent or name in self.unanswered:
            raise ClientError("unreachable", "no answer in time")
        if arguments.get("token") not in (None, self.token):
            raise ClientError("no_lease", f"{self.holder} is in command now")
        group, _, what = name.partition("/")
        own = self.queue.requests[what] if group == "queue" else None
        reply: dict[str, Any] = (own or getattr(self, "_" + name.replace("/", "_")))(**arguments)
        if (wanted := arguments.get("id")) in self.held_back:
            self.waited_for.append(wanted)
            while wanted in self.held_back:
                await asyncio.sleep(0.02)
            self.given_late.append(wanted)
        return reply

    async def look(self, method: str) -> Any:
        """Return the newest events, plan or mesh."""
        return {"events": self.events_so_far, "plan": self.plan, "mesh": self.mesh}[method]

    def connectivity(self) -> Connectivity:
        """Return whether it publishes."""
        age_s = time.monotonic() - self._received_s
        alive = age_s < SILENT_S
        return Connectivity(alive, age_s, "" if alive else self.why_silent)

    def close(self) -> None:
        """Nothing to close."""

    # requests

    def _config(self) -> dict[str, Any]:
        return {"config": self.config, "toml": ""}

    def _lease_acquire(self, holder: str, force: bool = False) -> dict[str, Any]:
        before = self.holder
        if before is not None and not force:
            raise ClientError("lease_held", f"{before} is in command")
        self.holder, self.token = holder, f"token of {holder}"
        self._lease_until_s = time.monotonic() + LEASE_S
        self.event("lease", f"{holder} is in command")
        terms = {"lease_s": LEASE_S, "renew_within_s": 10.0}
        return {"token": self.token, "took_over_from": before, **terms}

    def _lease_renew(self, token: str) -> dict[str, Any]:
        self._lease_until_s = time.monotonic() + LEASE_S
        return {"lease_s": LEASE_S, "renew_within_s": 10.0}

    def _lease_release(self, token: str) -> dict[str, Any]:
        self._end_lease("was given back")
        return {}

    def _end_lease(self, how: str) -> None:
        self.event("lease", f"the lease of {self.holder} {how}")
        self.holder, self.token = None, ""
        if self.bench.state is State.ENABLED:
            self.enter(State.READY)

    def _enable(self, token: str) -> dict[str, Any]:
        self.enter(State.ENABLED)
        return {"state": "ENABLED"}

    def _disable(self, token: str) -> dict[str, Any]:
        self.enter(State.READY)
        return {"state": "READY"}

    def _stop(self, by: str = "") -> dict[str, Any]:
        self.event("request", f"stop by {by}")
        if self.plan is not None and not self.plan.over:
            self._show_plan(state="aborted", message="stopped")
        self.enter(State.OFF)
        return {"state": "OFF"}

    def _reset(self, token: str) -> dict[str, Any]:
        self.trip, self.bench.trip_bits = None, 0
        self.enter(State.READY)
        return {"state": "READY"}

    def _set(self, token: str, **fields: Any) -> dict[str, Any]:
        if abs(fields.get("torque_Nm") or 0.0) > self.config["limits"]["torque_Nm"]:
            raise ClientError("refused", "torque_Nm: above [limits] torque_Nm")
        self.bench.torque_target_Nm = fields.get("torque_Nm", self.bench.torque_target_Nm)
        self.bench.speed_target_Hz = fields.get("speed_Hz", self.bench.speed_target_Hz)
        if "compensate" in fields:
            self.bench.ripple_share = 1.0 if fields["compensate"] == "off" else 0.1
        return {"state": self.bench.state.name}

    def _note(self, text: str, by: str = "") -> dict[str, Any]:
        self.event("note", text, by=by)
        return {"t_ns": time.time_ns(), "recording": "sim-000.mcap"}

    def _plan_list(self) -> dict[str, Any]:
        return {"plans": self.plans}

    def _plan_start(self, name: str, settings: dict[str, Any], **rest: Any) -> dict[str, Any]:
        if settings.get("turns", 2) < 2:
            raise ClientError("invalid", f"{name}: setting turns: at least 2")
        self._points = documents.points(settings)
        outline = {"points": self._points, "estimate_s": 8.0 * len(self._points), "settings": {}}
        if not rest.get("dry_run"):
            self.enter(State.ENABLED)
            self._plan_s = time.monotonic()
            self.plan = PlanView(plan=name, state="running", points=len(self._points))
            self.event("plan", f"{name} started by {self.holder}")
            self._advance(self._plan_s)
        return outline

    def _plan_pause(self, token: str) -> dict[str, Any]:
        self._show_plan(state="paused")
        return {}

    def _plan_resume(self, token: str) -> dict[str, Any]:
        self._show_plan(state="running")
        return {}

    def _plan_abort(self, token: str) -> dict[str, Any]:
        self._show_plan(state="aborted", message=f"aborted by {self.holder}")
        self.enter(State.READY)
        return {}

    def _calibration_list(self) -> dict[str, Any]:
        return {"calibrations": self.calibrations}

    def _calibration_show(self, id: str) -> dict[str, Any]:
        return documents.calibration(id)

    # what happens

    def do(self, action: Callable[[], Any]) -> Any:
        """Do something in the server's thread, from another one, and return what it returns."""
        done: list[Any] = []
        over = threading.Event()

        def act() -> None:
            done.append(action())
            over.set()

        assert self._loop is not None
        self._loop.call_soon_threadsafe(act)
        assert over.wait(60)
        return done[0]

    def enter(self, state: State) -> None:
        """Go to a state."""
        before, self.bench.state = self.bench.state, state
        if before is not state:
            self.event("state", f"{before.name} -> {state.name}")
            self._publish_state()

    def trip_over_current(self) -> None:
        """Trip."""
        self.bench.trip_bits = Trip.OVER_CURRENT
        self.trip = documents.trip(time.time_ns())
        self.event("trip", self.trip["reason"])
        if self.plan is not None and not self.plan.over:
            self._show_plan(state="failed", message="the bench tripped")
        self.enter(State.TRIPPED)

    def show_precision(
        self, targets: dict[str, float], known: dict[str, float], obstacle: str = ""
    ) -> None:
        """Publish the half-widths that the plan under way gives by now."""
        self._show_plan(targets=targets, precision=known, obstacle=obstacle)

    def fall_silent(self, since_s: float) -> None:
        """Publish nothing, as for so long before."""
        self.silent = True
        self._received_s -= since_s

    def restart(self) -> None:
        """Begin again, as another process would."""
        self._started_s = time.monotonic()
        self.holder, self.token = None, ""
        self.bench.state = State.OFF
        self._publish_state()

    def connect_again(self) -> None:
        """Have what the daemon remembers taken in, as of another one."""
        self._connecting = asyncio.ensure_future(self.connected())

    def event(self, kind: str, message: str, **data: Any) -> None:
        """Publish an event."""
        event = Event(t_ns=time.time_ns(), kind=kind, message=message, data=data)
        self.events_so_far.append(event)
        self._take([("event", event)])

    def _step(self, now_s: float) -> None:
        if self.silent:
            self._due_s = now_s
            return
        count = int((now_s - self._due_s) * self.bench.rate_Hz)
        self._due_s += count / self.bench.rate_Hz
        items: list[Item] = []
        if count and not self.loop_ended:
            items.append(("ticks", self.bench.ticks(count, time.time_ns())))
        self._take([] if self.ticks_withheld else items)
        if self.holder is not None and now_s > self._lease_until_s:
            self._end_lease("ran out")
        if now_s - self._received_s >= STATE_S:
            self._advance(now_s)
            self._publish_state()

    def _advance(self, now_s: float) -> None:
        if self.plan is None or self.plan.over:
            return
        if self.plan.state == "running":
            elapsed_s = now_s - self._plan_s
            done = min(int(elapsed_s * self.points_per_s), len(self._points), self.points_max)
            self._at(done, elapsed_s)
        mesh = documents.mesh(self.plan.plan, self._points, self.plan.points_done)
        self.mesh = MeshView.model_validate(mesh)
        self._take([("mesh", self.mesh)])

    def _at(self, done: int, elapsed_s: float) -> None:
        count = len(self._points)
        if done == count:
            self._show_plan(
                state="done", points_done=count, fraction=1.0, message="all points taken"
            )
            self.enter(State.READY)
            return
        point = self._points[done]
        self.bench.torque_target_Nm, self.bench.speed_target_Hz = point
        left_s = (count - done) * 8.0
        step = f"{point[0]:g} Nm, {point[1]:g} Hz: capturing"
        self._show_plan(
            points_done=done, fraction=done / count, step=step, elapsed_s=done * 8.0, eta_s=left_s,
            recording="/runs/sim-20260101T090000000Z-calibrate-000.mcap",
        )  # fmt: skip

    def _show_plan(self, **changes: Any) -> None:
        assert self.plan is not None
        self.plan = self.plan.model_copy(update=changes)
        self._take([("plan", self.plan)])

    def _publish_state(self) -> None:
        self._received_s = time.monotonic()
        remaining_s = max(0.0, self._lease_until_s - self._received_s) if self.holder else 0.0
        state = documents.state(self, self._received_s - self._started_s, remaining_s)
        self._take([("state", BenchState.model_validate(state))])


class AppServer:
    """An application of the dashboard, in a thread of its own."""

    def __init__(self, app: Starlette, tokens: Tokens, port: int = 0) -> None:
        self._listener = listen(port)
        self.port = self._listener.getsockname()[1]
        self.urls = urls(self._listener, tokens)
        self._server = uvicorn.Server(
            uvicorn.Config(
                app,
                ws="websockets-sansio",
                ws_per_message_deflate=False,
                log_level="error",
                access_log=False,
                ws_ping_interval=None,
                timeout_graceful_shutdown=1,
            )
        )
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._server.serve(sockets=[self._listener])), daemon=True
        )

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._server.should_exit = True
        self._thread.join(60)
        self._listener.close()


class Server(AppServer):
    """The page's server over a stand-in."""

    def __init__(self, stand_in: StandIn, port: int = 0, tokens: Tokens | None = None) -> None:
        self.stand_in = stand_in
        self.tokens = tokens or Tokens(Role.OPERATOR)
        live = LiveBench("sim", stand_in.config)
        live.calibrated = list(CALIBRATED)
        pages = Pages(live, stand_in, "anna@bench")
        live.publish = pages.publish
        super().__init__(application(pages, self.tokens, stand_in), self.tokens, port)


def main() -> None:
    """Serve until Ctrl-C."""
    stand_in = StandIn(float(sys.argv[1]) if len(sys.argv) > 1 else 1000.0)
    stand_in.points_max = 1000
    with Server(stand_in, 8447) as server:
        sys.stdout.write(f"{server.urls.operator}\n{server.urls.viewer}\n")
        sys.stdout.flush()
        threading.Event().wait()


if __name__ == "__main__":
    main()
