"""Parts of a state as text, which several commands share."""

from datetime import datetime
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from motord.api.messages import BenchState
    from motord.api.plan_messages import PlanView
    from motord.api.published_message import ChannelView
    from motord.api.queue_messages import QueueView
    from motord.experiments.tracking.tracked import TrackedCalibration, TrackedQuantity


def number(value: float | None) -> str:
    """Return a number in three digits, or whole; "-" for none, 0 for less than 1e-6: rounding."""
    if value is None:
        return "-"
    return f"{value:.0f}" if abs(value) >= 999.5 else f"{0.0 if abs(value) < 1e-6 else value:.3g}"


def clock(t_ns: int) -> str:
    """Return the local time of day."""
    return f"{datetime.fromtimestamp(t_ns / 1e9).astimezone():%H:%M:%S}"


def moment(t_ns: int) -> str:
    """Return the local date and time of day, to the millisecond."""
    return f"{datetime.fromtimestamp(t_ns / 1e9).astimezone():%Y-%m-%d %H:%M:%S.%f}"[:-3]


def duration(seconds: float) -> str:
    """Return a time as `45 s`, `3.2 min` or `1.5 h`."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.1f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def causes(state: "BenchState") -> list[str]:
    """Return the causes of a trip with their meaning, the first one first."""
    ordered = sorted(state.trips, key=lambda trip: trip.name != state.first_trip)
    return [f"{trip.name}: {trip.meaning}" for trip in ordered]


def trip_values(state: "BenchState") -> list[str]:
    """Return what each quantity was at the trip, and its limit."""
    from motord.api.published_message import quantity_text

    values = state.trip.values if state.trip is not None else {}
    return [
        quantity_text(what, number(value.value), number(value.limit))
        for what, value in values.items()
    ]


def suggestion(state: "BenchState") -> str:
    """Return what to do about a trip, "" without one."""
    if state.state != "TRIPPED" or state.trip is None:
        return ""
    return f"{state.trip.action}; then `motord reset`"


def calibration(state: "BenchState") -> str:
    """Return the calibration in force, and the serious findings that were accepted with it."""
    c = state.calibration
    if c is None:
        return "none"
    accepted = f", in spite of {', '.join(c.findings)}" if c.findings else ""
    return f"{c.id}, {c.method}, {c.age} old{accepted}"


def recording(state: "BenchState") -> str:
    """Return where it is recorded and what is wrong with that, or why not."""
    r = state.recording
    where, trouble = (r.path, r.error) if r.recording else ("not recording", r.error or r.obstacle)
    return where + (f": {trouble}" if trouble else "")


def channel(view: "ChannelView") -> str:
    """Return value, status and, if it is not ok, what is known of why."""
    value = "no value" if view.value is None else f"{view.value:.6g} {view.unit}".strip()
    low, high = (view.warn_below, view.warn_above)
    if view.status == "trip":
        low, high = (view.trip_below, view.trip_above)
    below = view.value is not None and low is not None and view.value < low
    limit = low if below else high
    shown = limit is not None and view.status in ("warn", "trip")
    why = view.error or (f"limit {limit:g}" if shown else "")
    age = "" if view.age_s is None else f", {view.age_s:.1f} s old"
    return f"{value}, {view.status}{age}" + (f": {why}" if why else "")


def loop(state: "BenchState") -> str:
    """Return the timing of the loop over the last second."""
    t = state.loop
    late = (t.wake_late_us_p50, t.wake_late_us_p99, t.wake_late_us_max)
    return (
        f"{t.rate_Hz:g} Hz, missed {t.missed}; "
        + "late p50 {} p99 {} max {} us".format(*map(_whole, late))
        + f", work p99 {_whole(t.work_us_p99)} us"
    )


def _whole(value: float | None) -> str:
    return "-" if value is None else f"{value:.0f}"


def queue(queue: "QueueView") -> str:
    """Return where the queue of plans stands: why it is paused or waits, plans and time left."""
    why = f": {queue.message}" if queue.message else ""
    left = f", about {duration(queue.eta_s)}" if queue.length else ""
    return f"{queue.state}{why}; {queue.length} plan{'' if queue.length == 1 else 's'}{left}"


def precision(plan: "PlanView") -> str:
    """Return how precise a plan is by now, next to its targets; "" of a plan without."""
    from motord.sequencing.observation import Precision

    return Precision(0, plan.precision, plan.obstacle).to_text(plan.targets)


def plan_progress(plan: "PlanView") -> str:
    """Return points, time left and what the plan does now, or how it ended."""
    counted = f"{plan.points_done} of {plan.points} points"
    if plan.over:
        return counted + (f": {plan.message}" if plan.message else "")
    left = f", {duration(plan.eta_s)} left" if plan.state == "running" else ""
    return f"{counted}{left}" + (f", {plan.step}" if plan.step else "")


def tracked_lines(view: "TrackedCalibration", now_ns: int) -> list[str]:
    """Return what is tracked as text: a line for each quantity, against the calibration.

    `now_ns`: Unix time.
    """
    counted = f"{view.turns} turns, memory {view.memory_s:g} s" if view.turns else "nothing yet"
    head = f"tracked      {counted}{_newest_tracked(view, now_ns)}, against {view.calibration}"
    found = [head, *map(_tracked_line, view.quantities)]
    found += [f"- not seen: {meaning}" for meaning in view.unseen]
    return found + [f"- {view.obstacle}"] * bool(view.obstacle)


def _tracked_line(one: "TrackedQuantity") -> str:
    fixed = ", cannot be adopted" * (one.departed and not one.adoptable)
    return f"{'!' if one.departed else ' '} {one.name:<22} {one.figures()}{fixed}"


def _newest_tracked(view: "TrackedCalibration", now_ns: int) -> str:
    age_s = max(now_ns - view.t_ns, 0) / 1e9
    return f", the newest {duration(age_s)} old" if view.t_ns else ""


def tracked(view: "TrackedCalibration", now_ns: int) -> str:
    """Return in a line whether the calibration in force holds; `now_ns`: Unix time."""
    newest = _newest_tracked(view, now_ns)
    if departed := view.departed:
        figures = "; ".join(f"{one.name} {one.figures()}" for one in departed)
        return f"departed: {figures}{newest}"
    if not view.quantities:
        return view.obstacle or "nothing known yet"
    return f"{len(view.quantities)} quantities hold over {view.turns} turns{newest}"
