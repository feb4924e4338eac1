"""A client of one daemon: its state, its telemetry, its plans, and the lease to command with."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, TypeVar

import numpy as np

from motord.api import requests as rpc
from motord.api.endpoints import key
from motord.api.messages import BenchState, Event
from motord.api.plan_messages import MeshView, PlanView
from motord.api.queue_requests import QUEUE_LIST, QueueContent
from motord.api.replies import AvailablePlan, ConfigReply, NoteReply, PlanOutline, StateReply
from motord.client.connection import DaemonConnection
from motord.client.decoding import (
    decode_event,
    decode_events,
    decode_mesh,
    decode_mesh_or_none,
    decode_plan,
    decode_plan_or_none,
    decode_state,
    decode_ticks,
)
from motord.client.error import ClientError
from motord.client.holder import operator
from motord.client.lease import Lease
from motord.client.plan_run import PlanRun
from motord.client.subscription import DocumentSubscription, Subscription, TickSubscription

KEPT_BLOCKS = 500
"""Blocks of ticks that wait for a slow reader: ten seconds with the usual `[zenoh] block_s`."""

_Document = TypeVar("_Document", bound=BenchState | PlanView)


class Client(DaemonConnection):
    """A connection to one daemon. Use it as a context manager, or call `close`.

    Everything here may be done without the lease, by anyone who may connect.
    """

    def state(self) -> BenchState:
        """Return the newest state, which the daemon renews ten times a second."""
        return decode_state(self.ask("state"))

    def events(self) -> list[Event]:
        """Return the newest events that the daemon remembers, the oldest first."""
        return decode_events(self.ask("event"))

    def plan(self) -> PlanView | None:
        """Return the progress of the plan under way or of the last one."""
        return decode_plan_or_none(self.ask("plan"))

    def mesh(self) -> MeshView | None:
        """Return the operating points of the plan under way or of the last one."""
        return decode_mesh_or_none(self.ask("mesh"))

    def follow_plan(self) -> PlanRun:
        """Return the plan under way or the last one, to iterate over its progress.

        Raises ClientError "refused" if there has been none.
        """
        progress = self.plan()
        if progress is None:
            raise ClientError("refused", "no plan has run since the daemon started")
        return PlanRun(self, progress.run_id)

    def plans(self) -> list[AvailablePlan]:
        """Return the plans that can be started, with the settings of this bench."""
        return self.call(rpc.PLAN_LIST).plans

    def dry_run(
        self, name: str, settings: Mapping[str, Any] | None = None, *, check: bool = True
    ) -> PlanOutline:
        """Check a plan against the bench's limits and return what it would do; nothing moves.

        check: as of `start_plan`.

        >>> outline = client.dry_run("cogging", {"speeds_Hz": [0.5, 1.0], "turns": 2})
        >>> [(point["speed_Hz"], point["turns"]) for point in outline.points]
        [(0.5, 2), (1.0, 2)]
        """
        more = {} if check else {"check": False}  # which older daemons do not know
        given = dict(settings or {})
        return self.call(rpc.PLAN_START, name=name, settings=given, dry_run=True, **more)

    def queue(self) -> QueueContent:
        """Return the queue of plans, and how its runs have ended."""
        return self.call(QUEUE_LIST)

    def config(self) -> ConfigReply:
        """Return the bench file as text, and with all defaults."""
        return self.call(rpc.CONFIG)

    def stop(self, by: str | None = None) -> StateReply:
        """Zero current now and OFF, whoever is in command. by: for the log; you by default.

        >>> client.stop().state
        'OFF'
        """
        return self.call(rpc.STOP, by=operator() if by is None else by)

    def note(self, text: str, by: str | None = None) -> NoteReply:
        """Put a remark with its time into the events and, if one is running, the recording."""
        return self.call(rpc.NOTE, text=text, by=operator() if by is None else by)

    def lease(
        self,
        holder: str | None = None,
        *,
        force: bool = False,
        alive: Callable[[], bool] = lambda: True,
    ) -> Lease:
        """Return a lease: a context manager that acquires, renews and releases it.

        holder: shown to others. force: take over from whoever is in command; it is logged. alive:
        asked in the thread that renews; a program that hangs can lose the lease so, and the bench
        then ramps down.
        """
        return Lease(self, holder or operator(), force=force, alive=alive)

    def subscribe_state(
        self, callback: Callable[[BenchState], None] | None = None, *, latest: bool = True
    ) -> DocumentSubscription[BenchState]:
        """Receive the state now, then ten times a second and when it changes.

        latest: begin with the state now instead of the next one that is published.

        >>> with client.subscribe_state() as states:
        ...     states.get(timeout_s=0).bench
        'sim'
        """
        return self._documents("state", decode_state, callback, self.state if latest else None)

    def subscribe_plan(
        self, callback: Callable[[PlanView], None] | None = None, *, latest: bool = True
    ) -> DocumentSubscription[PlanView]:
        """Receive the progress of plans; `latest` as for `subscribe_state`, if there has been one.

        For one plan until its end: `follow_plan`, or `run_plan` of the lease.
        """
        return self._documents("plan", decode_plan, callback, self.plan if latest else None)

    def subscribe_mesh(
        self, callback: Callable[[MeshView], None] | None = None
    ) -> Subscription[MeshView]:
        """Receive the operating points of a plan whenever something becomes of one."""
        return Subscription(self._session, key(self.bench, "mesh"), decode_mesh, callback)

    def subscribe_events(
        self, callback: Callable[[Event], None] | None = None
    ) -> Subscription[Event]:
        """Receive events as they happen; `events` has earlier ones."""
        return Subscription(self._session, key(self.bench, "event"), decode_event, callback)

    def subscribe_ticks(
        self, callback: Callable[[np.ndarray], None] | None = None, *, kept: int = KEPT_BLOCKS
    ) -> TickSubscription:
        """Receive every tick, in blocks: structured arrays of shape (n,), `schema.TICK_DTYPE`.

        kept: blocks that wait to be read; older ones are lost. `losses` says what is missing.

        >>> with client.subscribe_ticks() as ticks:
        ...     block = ticks.get()
        >>> first, last = block["tick"][[0, -1]].tolist()
        >>> len(block) + ticks.lost_ticks + ticks.losses.missed_ticks == last - first + 1
        True
        """
        where = key(self.bench, "ticks")
        return TickSubscription(self._session, where, decode_ticks, callback, kept)

    def _documents(
        self,
        name: str,
        decode: Callable[[bytes], _Document],
        callback: Callable[[_Document], None] | None,
        latest: Callable[[], _Document | None] | None,
    ) -> DocumentSubscription[_Document]:
        subscription = DocumentSubscription(self._session, key(self.bench, name), decode, callback)
        if latest is not None:
            with suppress(ClientError):  # it comes with the next one, if the daemon is there
                if (document := latest()) is not None:
                    subscription.add_latest(document)
        return subscription
