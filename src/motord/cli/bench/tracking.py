"""What is tracked of the calibration in force as text, which several commands share."""

from typing import TYPE_CHECKING

from motord.cli.bench.wording import duration

if TYPE_CHECKING:
    from motord.api.tracking_messages import TrackedView, TrackingView


def lines(view: "TrackingView", now_ns: int) -> list[str]:
    """Return what is tracked as text: a line for each quantity, against the calibration.

    `now_ns`: Unix time.
    """
    counted = f"{view.turns} turns, memory {view.memory_s:g} s" if view.turns else "nothing yet"
    head = f"tracked      {counted}{_newest(view, now_ns)}, against {view.calibration}"
    found = [head, *map(_line, view.quantities)]
    found += [f"- not seen: {meaning}" for meaning in view.unseen]
    return found + [f"- {view.obstacle}"] * bool(view.obstacle)


def _line(one: "TrackedView") -> str:
    fixed = ", cannot be adopted" * (one.departed and not one.adoptable)
    return f"{'!' if one.departed else ' '} {one.name:<22} {one.figures()}{fixed}"


def _newest(view: "TrackingView", now_ns: int) -> str:
    age_s = max(now_ns - view.t_ns, 0) / 1e9
    return f", the newest {duration(age_s)} old" if view.t_ns else ""


def short(view: "TrackingView", now_ns: int) -> str:
    """Return in a line whether the calibration in force holds; `now_ns`: Unix time."""
    newest = _newest(view, now_ns)
    if departed := view.departed:
        figures = "; ".join(f"{one.name} {one.figures()}" for one in departed)
        return f"departed: {figures}{newest}"
    if not view.quantities:
        return view.obstacle or "nothing known yet"
    return f"{len(view.quantities)} quantities hold over {view.turns} turns{newest}"
