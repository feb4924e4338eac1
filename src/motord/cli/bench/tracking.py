"""What is tracked of the calibration in force as text, which several commands share."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from motord.api.tracking_messages import TrackedView, TrackingView


def lines(view: "TrackingView") -> list[str]:
    """Return what is tracked as text: a line for each quantity, against the calibration."""
    counted = f"{view.turns} turns, memory {view.memory_s:g} s" if view.turns else "nothing yet"
    head = f"tracked      {counted}, against {view.calibration}"
    found = [head, *map(_line, view.quantities)]
    found += [f"- not seen: {meaning}" for meaning in view.unseen]
    return found + [f"- {view.obstacle}"] * bool(view.obstacle)


def _line(one: "TrackedView") -> str:
    return f"{'!' if one.departed else ' '} {one.name:<22} {one.figures()}"


def short(view: "TrackingView | None") -> str:
    """Return in a line whether the calibration in force holds; "" if it is not tracked."""
    if view is None:
        return ""
    if departed := view.departed:
        return "departed: " + "; ".join(f"{one.name} {one.figures()}" for one in departed)
    if not view.quantities:
        return view.obstacle or "nothing known yet"
    return f"{len(view.quantities)} quantities hold over {view.turns} turns"
