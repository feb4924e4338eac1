"""A small picture of a figure: its limits with their guard bands, value and interval."""

from motord.verdict.decision import FigureVerdict

WIDTH, HEIGHT = 120.0, 14.0
MARGIN = 0.25
"""Of the range between the limits, to each side of them."""


def bar(one: FigureVerdict) -> str:
    """Return an SVG, or nothing for a figure without a value.

    The band is what conforms, its darker part what passes; the mark is the value, with its 95 %
    interval. What lies outside of the picture is drawn at its edge.
    """
    figure = one.figure
    if figure.value is None:
        return ""
    half = figure.expanded_uncertainty or 0.0
    axis = _Axis.of(one, half)
    guard = one.guard_band or 0.0
    low, high = one.tolerance.low, one.tolerance.high
    left = axis.start if low is None else low
    right = axis.end if high is None else high
    parts = [_band(axis, left, right, 0.35)]
    inner = (left if low is None else left + guard, right if high is None else right - guard)
    if inner[0] < inner[1]:
        parts.append(_band(axis, *inner, 1.0))
    parts += [_line(axis(limit), 1, 13, "--ink", 1.0) for limit in (low, high) if limit is not None]
    a, b = axis(figure.value - half), axis(figure.value + half)
    colour = {"pass": "--reference", "fail": "--serious", "undecidable": "--other"}[one.decision]
    parts.append(f'<rect x="{a:.1f}" y="6" width="{b - a:.1f}" height="2" fill="var({colour})"/>')
    parts.append(_line(axis(figure.value), 3, 11, colour, 2.5))
    return (
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" aria-label="value between limits">'
        f"{''.join(parts)}</svg>"
    )


class _Axis:
    """Positions in the picture of values; those beyond its range are at its edge."""

    def __init__(self, start: float, end: float) -> None:
        self.start, self.end = start, end

    @classmethod
    def of(cls, one: FigureVerdict, half: float) -> "_Axis":
        low, high, value = one.tolerance.low, one.tolerance.high, one.figure.value or 0.0
        if low is not None and high is not None:
            margin = MARGIN * (high - low)
            return cls(low - margin, high + margin)
        limit = low if low is not None else high if high is not None else 0.0
        span = max(abs(value - limit), half, abs(limit) * 1e-6, 1e-12) * (1 + 2 * MARGIN)
        return cls(limit - span, limit + span)

    def __call__(self, value: float) -> float:
        part = (value - self.start) / (self.end - self.start)
        return WIDTH * min(max(part, 0.02), 0.98)


def _band(axis: _Axis, start: float, end: float, opacity: float) -> str:
    a, b = axis(start), axis(end)
    return (
        f'<rect x="{a:.1f}" y="2" width="{max(b - a, 0):.1f}" height="10" fill="var(--grid)" '
        f'fill-opacity="{opacity:g}"/>'
    )


def _line(x: float, top: float, bottom: float, colour: str, width: float) -> str:
    return (
        f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{top:g}" y2="{bottom:g}" stroke="var({colour})" '
        f'stroke-width="{width:g}"/>'
    )
