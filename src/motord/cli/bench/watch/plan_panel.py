"""The plan on the screen: its progress, and how precise it is by now."""

from rich.text import Text

from motord.api.messages import BenchState
from motord.cli.bench import wording
from motord.cli.bench.watch.glyphs import Glyphs
from motord.cli.bench.watch.panels import row, wrapped

PRECISION_ROWS = 4
QUEUE_ROWS = 2


def plan(state: BenchState, glyphs: Glyphs) -> list[Text]:
    """Return the plan under way, or the last one."""
    p = state.plan
    if p is None:
        return [row("plan", "none since the daemon started")]
    cells = 16
    done = round(cells * min(max(p.fraction, 0.0), 1.0))
    bar = glyphs.bar[0] * done + glyphs.bar[1] * (cells - done)
    most = "at most " if p.targets else ""
    left = "" if p.over else f"  {most}{wording.duration(p.eta_s)} left"
    head = row("plan", (f"{p.plan} {p.state}", "bold"), f"  {bar} {100 * p.fraction:.0f} %{left}")
    if p.over:
        return [head, row("", wording.plan_progress(p))]
    how = "; detached" if p.detached else f"; started by {p.started_by}" if p.started_by else ""
    return [head, row("", f"{p.points_done} of {p.points} points; {p.step or p.state}{how}")]


def queue(state: BenchState, width: int) -> list[Text]:
    """Return where the queue of plans stands; nothing if it is empty."""
    if state.queue is None or not (state.queue.length or state.queue.active):
        return []
    return wrapped("queue", wording.queue(state.queue), width)[:QUEUE_ROWS]


def precision(state: BenchState, width: int) -> list[Text]:
    """Return the half-widths that a plan gives by now next to its targets; of others nothing."""
    p = state.plan
    if p is None or not p.targets:
        return []
    known = ((name, p.precision.get(name), target) for name, target in p.targets.items())
    lines = wrapped("precision", ", ".join(_against_target(*one) for one in known), width)
    if p.obstacle:
        lines += wrapped("", f"does not end early: {p.obstacle}", width)
    return lines[:PRECISION_ROWS]


def _against_target(name: str, half_width: float | None, target: float) -> str:
    if half_width is None:
        return f"{name} ? of {target:g}"
    return f"{name} {half_width:.3g} of {target:g}" + " (reached)" * (half_width <= target)
