"""All benches as the overview shows them, those that have vanished among them. Pure."""

from collections.abc import Callable, Iterable
from pathlib import PurePath
from typing import Any

from motord.api.descriptions import TRIP_ACTION
from motord.api.messages import BenchState
from motord.client.roster import BenchEntry
from motord.schema import Trip

VANISHED_MAX = 100
"""Benches that are gone and still shown; the one that went first is forgotten."""


class BenchList:
    """What was last known of each bench; `command` says how to open its own page."""

    def __init__(self, command: Callable[[BenchEntry], str]) -> None:
        self._command = command
        self._there: dict[str, dict[str, Any]] = {}
        self._gone: dict[str, dict[str, Any]] = {}

    def update(self, entries: Iterable[BenchEntry], unix_ns: int) -> list[dict[str, Any]]:
        """Return all benches by name, for JSON; who is not in `entries` any more vanished now."""
        there = {
            entry.bench: {**described(entry), "command": self._command(entry)} for entry in entries
        }
        for bench in self._there.keys() - there.keys():
            self._gone[bench] = {**self._there[bench], "gone_ns": unix_ns}
        for bench in there:
            self._gone.pop(bench, None)
        while len(self._gone) > VANISHED_MAX:
            del self._gone[next(iter(self._gone))]
        self._there = there
        return sorted((*there.values(), *self._gone.values()), key=lambda one: str(one["bench"]))


def described(entry: BenchEntry) -> dict[str, Any]:
    """Return a bench for JSON: whether it is there, and its state as far as it is shown."""
    names = ("bench", "silent", "age_s", "daemons", "problem")
    state = None if entry.state is None else _in_short(entry.state)
    return {**{name: getattr(entry, name) for name in names}, "gone_ns": None, "state": state}


def _in_short(state: BenchState) -> dict[str, Any]:
    tick, plan, queue = state.tick, state.plan, state.queue
    action = TRIP_ACTION.get(Trip[state.first_trip]) if state.first_trip in Trip.__members__ else ""
    recording = state.recording
    return {
        "t_ns": state.t_ns,
        "motor": state.motor,
        "simulated": state.simulated,
        "state": state.state,
        "fault": state.fault,
        "remedy": state.remedy,
        "trips": [trip.model_dump() for trip in state.trips],
        "first_trip": state.first_trip,
        "action": state.trip.action if state.trip is not None else action,
        "holder": state.lease.holder,
        "plan": None if plan is None else plan.model_dump(include=_PLAN),
        "queue": None if queue is None else queue.model_dump(include={"state", "length", "eta_s"}),
        "torque_Nm": None if tick is None else tick.torque_Nm,
        "torque_set_Nm": None if tick is None else tick.torque_set_Nm,
        "speed_Hz": None if tick is None else tick.speed_Hz,
        "mean_measured": state.torque_sensor.passes_mean,
        "recording": recording.recording,
        "recording_name": PurePath(recording.path).name if recording.recording else "",
        "recording_trouble": recording.error or recording.obstacle,
    }


_PLAN = {
    "plan", "state", "fraction", "points", "points_done", "eta_s", "message", "serial", "targets",
}  # fmt: skip
