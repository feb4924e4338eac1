"""What is published when, and the full state of bench and daemon, also by name for recordings."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np

from motord.api.descriptions import trip_names
from motord.api.messages import BenchState, DeviceView, Event, LeaseView, TorqueSensorView
from motord.api.plan_messages import MeshView, PlanView
from motord.service.bench.bench import Bench
from motord.service.bench.calibrations import CalibrationStore
from motord.service.bench.guard import Guard
from motord.service.host import scheduling
from motord.service.host.children import Children
from motord.service.host.loop_link import LoopLink
from motord.service.plans.mesh import window
from motord.service.publish.telemetry import Telemetry
from motord.service.recording.control import RecordingControl
from motord.service.tracker.link import TrackerLink

STATE_NS = 100_000_000


@dataclass
class Publisher:
    """Feeds the telemetry, and keeps the newest documents for any thread that asks.

    Ticks are published as they come, state and plan ten times a second and on change, the mesh on
    change. Times are monotonic ns, but for `unix_ns`.
    """

    bench: Bench
    calibrations: CalibrationStore
    children: Children
    recording: RecordingControl
    loop: LoopLink
    guard: Guard
    telemetry: Telemetry
    tracker: TrackerLink | None
    started_ns: int
    unix_ns: Callable[[], int]
    _state_ns: int = 0
    _plan_ns: int = 0
    _change_key: tuple[object, ...] = ()
    _plan: PlanView | None = None
    _mesh: MeshView | None = None
    _state_json: bytes = b"null"

    def step(self, block: np.ndarray, now_ns: int) -> None:
        """Publish what is due at `now_ns` (monotonic)."""
        self.telemetry.ticks(block)
        self.publish_documents(now_ns)

    def publish_documents(self, now_ns: int) -> None:
        """Publish state and plan if they are due or have changed."""
        key = change_key(self.bench, self.recording.path, now_ns)
        if key != self._change_key or now_ns - self._state_ns >= STATE_NS:
            self._change_key, self._state_ns = key, now_ns
            self._state_json = self.state(now_ns).to_json()
            self.telemetry.json("state", self._state_json)
        self._publish_plan(now_ns)
        mesh, before = self.bench.plans.mesh, self._mesh
        if mesh is not None and mesh is not before:
            self._mesh = mesh
            self.telemetry.json("mesh", window(mesh).to_json())

    def event(self, event: Event) -> None:
        """Publish an event."""
        self.telemetry.json("event", event.to_json())

    @property
    def documents(self) -> dict[str, Callable[[], bytes]]:
        """What answers who asks for the newest, by key."""
        events, plans = self.bench.events, self.bench.plans
        return {
            "state": lambda: self._state_json,
            "event": lambda: b"[%b]" % b",".join(event.to_json() for event in events.recent()),
            "plan": lambda: view.to_json() if (view := self._plan_view()) is not None else b"null",
            "mesh": lambda: window(mesh).to_json() if (mesh := plans.mesh) is not None else b"null",
        }

    def _plan_view(self) -> PlanView | None:
        """Return the plan's progress with a time, taken first: what is older came before it."""
        t_ns, view = self.unix_ns(), self.bench.plans.view
        return view.model_copy(update={"t_ns": t_ns}) if view is not None else None

    def _publish_plan(self, now_ns: int) -> None:
        view, before = self.bench.plans.view, self._plan
        if view is None or view is before:
            return
        changed = before is None or (view.state, view.points_done) != (
            before.state,
            before.points_done,
        )
        if changed or now_ns - self._plan_ns >= STATE_NS:
            self._plan, self._plan_ns = view, now_ns
            self.telemetry.json("plan", view.model_copy(update={"t_ns": self.unix_ns()}).to_json())

    def state(self, now_ns: int) -> BenchState:
        """Return the full state of bench and daemon now."""
        bench, config = self.bench, self.bench.config
        trips, first = bench.monitor.trips()
        holder = bench.commander(now_ns)
        return BenchState(
            bench=config.bench.name,
            motor=f"{config.motor.name} {config.motor.serial}".strip(),
            simulated=config.simulated,
            version=_version(),
            t_ns=self.unix_ns(),
            uptime_s=round((now_ns - self.started_ns) / 1e9, 1),
            state=bench.state.name,
            fault=bench.fault,
            remedy=bench.loop.remedy,
            trips=trips,
            first_trip=first,
            trip=bench.monitor.trip,
            tick=bench.monitor.tick_view(),
            torque_sensor=TorqueSensorView(
                highpass_time_constant_s=config.torque_sensor.highpass_time_constant_s
            ),
            setpoint=bench.setpoint_view(),
            lease=LeaseView(
                holder=holder,
                remaining_s=round(bench.lease.remaining_s(now_ns), 2),
                duration_s=config.zenoh.lease_s,
            ),
            plan=self._plan_view(),
            queue=bench.queue,
            loop=bench.monitor.loop_view(now_ns),
            ages=ages_s(bench, now_ns),
            links=bench.monitor.links_view(),
            realtime={**self.loop.realtime(), "supervisor": scheduling.priority_text()},
            recording=self.recording.view(),
            calibration=self.calibrations.view(),
            tracking=self.tracker.view if self.tracker is not None else None,
            brake=device_view(bench, "brake", now_ns),
            drive=device_view(bench, "drive", now_ns),
            channels=bench.channels.views(now_ns),
            bridge_clock=self.loop.bridge_clock(),
            processes=self.children.views(),
            faults=dict(self.guard.faults),
            telemetry_dropped=self.telemetry.dropped,
        )


def ages_s(bench: Bench, now_ns: int) -> dict[str, float]:
    """Return the age (s) of every signal that there is: of the loop, and of slow devices."""
    devices = {name: device.view(now_ns).age_s for name, device in bench.devices.items()}
    known = {name: age_s for name, age_s in devices.items() if age_s is not None}
    return {**bench.monitor.ages_s(now_ns), **known}


def device_view(bench: Bench, name: str, now_ns: int) -> DeviceView:
    """Return a slow device, on a wire, in the simulated rig or not there."""
    if name in bench.devices:
        return bench.devices[name].view(now_ns)
    return DeviceView(health="simulated" if bench.has(name) else "none")


def change_key(bench: Bench, recording_path: str, now_ns: int) -> tuple[object, ...]:
    """Return what makes a state worth publishing at once when it changes; cheap to make."""
    plan = bench.plans.view
    progress = (plan.plan, plan.state, plan.points_done) if plan is not None else None
    queue = bench.queue.state, bench.queue.running, bench.queue.next, bench.queue.length
    return named_state(bench, now_ns), progress, queue, bench.calibrated, recording_path


@cache
def _version() -> str:
    return version("motord")


def named_state(bench: Bench, now_ns: int) -> dict[str, Any]:
    """Return state, trips, set-point, holder of the lease and plan; cheap. Monotonic ns."""
    setpoint, view = bench.setpoint, bench.plans.view
    plan = view if view is not None and bench.plans.active else None
    trips, first = bench.monitor.trip_bits, bench.monitor.first_trip
    return {
        "state": bench.state.name,
        "fault": bench.fault,
        "trips": trip_names(trips) if trips else [],
        "first_trip": trip_names(first)[0] if first else "",
        "holder": bench.commander(now_ns) or "",
        "plan": plan.plan if plan else "",
        "plan_state": plan.state if plan else "",
        "torque_Nm": setpoint.torque_Nm,
        "speed_Hz": setpoint.speed_Hz or 0.0,
        "drive_Hz": setpoint.drive_Hz,
        "compensate": int(setpoint.compensate),
    }
