"""Spans of driven operating points that are not used, each with its reason."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from motord.identification import CaptureError
from motord.identification.operating_points import PointData

UNUSABLE = "no numbers, counts out of range, or times that do not rise"
LOST = "turns that may be lost between samples"
PART = "part of a turn"
"""At the beginning, at the end or at a reversal: no whole turn of one direction."""


@dataclass(frozen=True)
class LeftOut:
    """A span that was not used; begin_s, end_s: since the first sample of the point `of`.

    duration_s: of the samples in it, which may be scattered.
    """

    of: str
    reason: str
    begin_s: float
    end_s: float
    duration_s: float


def spans_left_out(
    of: str, t_s: np.ndarray, usable: np.ndarray, reasons: np.ndarray
) -> tuple[LeftOut, ...]:
    """Return the spans of a point that were not used, in time order.

    t_s (n,): of all samples; usable (n,): those that could be used, m of them; reasons (m,) of str:
    why each of these was not used, "" if it was.
    """
    if not t_s.size:
        return ()
    why = np.full(t_s.size, UNUSABLE, dtype=object)
    why[usable] = reasons
    period_s = float(np.median(np.diff(t_s[usable]))) if usable.sum() > 1 else 0.0
    found = []
    scattered = np.flatnonzero(~usable)
    if scattered.size:
        found.append(_span(of, UNUSABLE, t_s, scattered, period_s))
    places = np.flatnonzero(usable)
    edges = np.flatnonzero(reasons[1:] != reasons[:-1]) + 1
    for first, end in pairwise([0, *edges.tolist(), reasons.size]):
        if end > first and reasons[first]:
            found.append(_span(of, str(reasons[first]), t_s, places[first:end], period_s))
    return tuple(sorted(found, key=lambda one: one.begin_s))


def _span(of: str, reason: str, t_s: np.ndarray, places: np.ndarray, period_s: float) -> LeftOut:
    at_s = t_s[places]
    finite = at_s[np.isfinite(at_s)]
    return LeftOut(
        of, reason, float(finite.min()), float(finite.max()) + period_s, places.size * period_s
    )


def whole_left_out(point: PointData, number: int, error: CaptureError) -> LeftOut:
    """Return a point that is left out whole, for an error of its own."""
    t_ns = point.ticks["t_ns"]
    duration_s = float(np.ptp(t_ns)) * 1e-9 if t_ns.size else 0.0
    reason = f"{point.recording}: {error}" if point.recording else str(error)
    return LeftOut(f"point {number}", reason, 0.0, duration_s, duration_s)
