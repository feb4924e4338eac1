"""From a daemon to the server: subscriptions, limits of rate, and connecting again."""

import json
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from math import ceil
from typing import Any

from motord.api.messages import BenchState, Event
from motord.api.plan_messages import MeshView, PlanView
from motord.client import Client, ClientError
from motord.foxglove import topics
from motord.foxglove.decimation import Decimator
from motord.foxglove.server import FoxgloveServer
from motord.recording.event_log import event_message
from motord.sequencing.settings import COMPENSATE
from motord.wire.ticks.blocks import Block

SILENT_S = 2.0
"""Without a state for so long the daemon counts as gone; ten come a second."""
REPEAT_S = 1.0
"""Documents that come on change are sent again so often."""
RETRY_S = 1.0
_NAMES = ("state", "fault", "trips", "holder", "plan", "plan_state")
"""A state in which one of these has changed is always sent."""
_PERIOD_NS = round(1e9 / topics.RATE_HZ)
MAX_ITEMS = 64
"""Longer lists, such as a table of the back-EMF, are given by their length alone."""


class ViewerFeed:
    """Receives what a daemon publishes and sends it to viewers, a connection long.

    Each method is called by one thread of the client. Log times are the bench's: `t_ns` of ticks,
    states and events.
    """

    def __init__(self, server: FoxgloveServer, loop_rate_Hz: float) -> None:
        self._server = server
        self._decimator = Decimator(ceil(loop_rate_Hz / topics.RATE_HZ))
        self._t_ns = time.time_ns()  # of the newest tick, once there is one
        self._shown: list[object] = []
        self._state_ns = self._plan_ns = 0
        self._newest: dict[str, bytes] = {}
        self.received_s = time.monotonic()

    def ticks(self, block: Block) -> None:
        """Send what `block` completes, if anybody looks at it."""
        if len(block):
            self._t_ns = int(block["t_ns"][-1])
        if not self._server.wanted(topics.TICK.name, topics.EXTREMES.name):
            self._decimator.skip(block)
            return
        decimated = self._decimator.take(block)
        for t_ns, tick, extremes in zip(
            decimated.counts[:, 0].tolist(), *decimated.messages(), strict=True
        ):
            self._server.log(topics.TICK.name, tick, t_ns)
            self._server.log(topics.EXTREMES.name, extremes, t_ns)

    def state(self, state: BenchState) -> None:
        """Send a state, unless one that shows the same was sent just before."""
        self.received_s = time.monotonic()
        named = _named_state(state)
        shown = [named[key] for key in _NAMES]
        if shown == self._shown and 0 <= state.t_ns - self._state_ns < _PERIOD_NS:
            return
        self._shown, self._state_ns = shown, state.t_ns
        self._server.log(topics.STATE.name, json.dumps(named).encode(), state.t_ns)
        self._server.log(topics.BENCH.name, state.to_json(), state.t_ns)

    def plan(self, plan: PlanView) -> None:
        """Send a plan's progress, unless it was sent just before."""
        if not plan.over and 0 <= self._t_ns - self._plan_ns < _PERIOD_NS:
            return
        self._plan_ns = self._t_ns
        self._newest[topics.PLAN.name] = plan.to_json()
        self._server.log(topics.PLAN.name, self._newest[topics.PLAN.name], self._t_ns)

    def mesh(self, mesh: MeshView) -> None:
        """Send the operating points of a plan; they come when one of them changes."""
        self._newest[topics.MESH.name] = mesh.to_json()
        self._server.log(topics.MESH.name, self._newest[topics.MESH.name], self._t_ns)

    def repeat(self) -> None:
        """Send plan and mesh again, for viewers that came late."""
        for topic, content in list(self._newest.items()):
            self._server.log(topic, content, self._t_ns)

    def event(self, event: Event) -> None:
        """Send an event."""
        content = event_message(event.t_ns, event.kind, event.message, event.data)
        self._server.log(topics.EVENT.name, json.dumps(content).encode(), event.t_ns)


def _named_state(state: BenchState) -> dict[str, Any]:
    """Return the state by name, as topic `/state` of a recording has it."""
    setpoint = state.setpoint
    plan = state.plan if state.plan is not None and not state.plan.over else None
    return {
        "t_ns": state.t_ns,
        "state": state.state,
        "fault": state.fault,
        "trips": [trip.name for trip in state.trips],
        "first_trip": state.first_trip,
        "holder": state.lease.holder or "",
        "plan": plan.plan if plan is not None else "",
        "plan_state": plan.state if plan is not None else "",
        "torque_Nm": setpoint.torque_Nm,
        "speed_Hz": setpoint.speed_Hz or 0.0,
        "drive_Hz": setpoint.drive_Hz,
        "compensate": int(COMPENSATE[setpoint.compensate]),
    }


def values_by_path(tables: Mapping[Any, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values in nested tables, and lists of them, by dotted path; none that is null.

    The SDK refuses a value with null anywhere in it.
    """
    for key, value in tables.items():
        path = f"{prefix}{key}"
        if isinstance(value, list) and len(value) > MAX_ITEMS:
            yield path, f"{len(value)} values"
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            yield from values_by_path(dict(enumerate(value)), f"{path}.")
        elif isinstance(value, Mapping):
            yield from values_by_path(value, f"{path}.")
        elif value is not None:
            yield path, value


def feed(client: Client, server: FoxgloveServer, stopping: threading.Event) -> None:
    """Feed `server` until `stopping` is set. Raises ClientError when the daemon is gone."""
    config = client.config().config
    server.set_parameters(dict(values_by_path(config)))
    one = ViewerFeed(server, config["loop"]["rate_Hz"])
    with (
        client.subscribe_state(one.state),
        client.subscribe_events(one.event),
        client.subscribe_plan(one.plan),
        client.subscribe_mesh(one.mesh),
        client.subscribe_ticks(one.ticks),
    ):
        server.say_connected()
        if (plan := client.plan()) is not None:
            one.plan(plan)
        if (mesh := client.mesh()) is not None:
            one.mesh(mesh)
        while not stopping.wait(REPEAT_S):
            one.repeat()
            if time.monotonic() - one.received_s > SILENT_S:
                raise ClientError("unreachable", f"bench {client.bench} is silent: has it ended?")


def run(
    connect: Callable[[], Client],
    server: FoxgloveServer,
    say: Callable[[str], None],
    stopping: threading.Event,
) -> None:
    """Feed `server` from the daemon that `connect` finds until `stopping` is set.

    When the daemon is gone `say` gets a line, viewers a status, and it is looked for again.
    """
    lost = ""
    while not stopping.is_set():
        try:
            with connect() as client:
                if lost:
                    say(f"bench {client.bench} is back")
                    lost = ""
                feed(client, server, stopping)
        except ClientError as error:
            if not lost:
                lost = f"{error}; connecting again every {RETRY_S:g} s"
                say(lost)
                server.say_disconnected(lost)
            stopping.wait(RETRY_S)
