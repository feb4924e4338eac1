"""When what is published: ticks as they come, state and plan ten times a second and on change."""

from collections.abc import Callable

import numpy as np

from motord.api.messages import Event, PlanView
from motord.service.publish.state import StateView, change_key

STATE_NS = 100_000_000


class Publisher:
    """Feeds the telemetry, and keeps the newest documents for any thread that asks."""

    def __init__(self, state: StateView) -> None:
        self._state, self._bench, self._telemetry = state, state.bench, state.telemetry
        self._state_ns = self._plan_ns = 0
        self._change_key: tuple[object, ...] = ()
        self._plan: PlanView | None = None
        self._state_json = b"null"

    def step(self, block: np.ndarray, now_ns: int) -> None:
        """Publish what is due at `now_ns` (monotonic)."""
        self._telemetry.ticks(block)
        key = change_key(self._bench, self._state.recording.view().path, now_ns)
        if key != self._change_key or now_ns - self._state_ns >= STATE_NS:
            self._change_key, self._state_ns = key, now_ns
            self._state_json = self._state.build(now_ns).to_json()
            self._telemetry.json("state", self._state_json)
        self._publish_plan(now_ns)

    def event(self, event: Event) -> None:
        """Publish an event."""
        self._telemetry.json("event", event.to_json())

    @property
    def documents(self) -> dict[str, Callable[[], bytes]]:
        """What answers who asks for the newest, by key."""
        events, plans = self._bench.events, self._bench.plans
        return {
            "state": lambda: self._state_json,
            "event": lambda: b"[%b]" % b",".join(event.to_json() for event in events.recent()),
            "plan": lambda: view.to_json() if (view := plans.view) is not None else b"null",
        }

    def _publish_plan(self, now_ns: int) -> None:
        view, before = self._bench.plans.view, self._plan
        if view is None or view is before:
            return
        changed = before is None or (view.state, view.points_done) != (
            before.state,
            before.points_done,
        )
        if changed or now_ns - self._plan_ns >= STATE_NS:
            self._plan, self._plan_ns = view, now_ns
            self._telemetry.json("plan", view.to_json())
