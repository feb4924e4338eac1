"""The certificate of a tested motor: one page of A4, and the same as JSON."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from math import ceil
from typing import Any

from motord.experiments.analysis import encode
from motord.intervals import plus_minus
from motord.report.html import Markup, Page, Verbatim
from motord.verdict.decision import Figure, FigureVerdict, MotorVerdict
from motord.verdict.motor_type import MotorType
from motord.verdict.recordings import UsedRecording

SCHEMA = "motord.verdict/1"

_STYLE = """
main{max-width:56rem}.section{margin:1rem 0 .25rem}table{width:100%;margin:.25rem 0}
td svg{display:block;width:7.5rem;height:.9rem}
th,td{padding:.15rem .6rem .15rem 0}.numbers td:not(:first-child){padding-left:.4rem}
code{overflow-wrap:anywhere}
.decision{font-weight:600}.pass{color:var(--reference)}.fail{color:var(--serious)}
.undecidable{color:var(--other)}
@page{size:A4;margin:12mm}
@media print{body{font-size:8pt;line-height:1.25}h1{font-size:15pt}
 .section{font-size:10pt;margin:5pt 0 0}
 .card{padding:3pt 6pt}.card b{font-size:12pt}.cards{margin:4pt 0;gap:6pt}table{font-size:7pt}
 th,td{padding:1pt 4pt 1pt 0}p,ul{margin:2pt 0;max-width:none}.lead{margin-bottom:2pt}
 td svg{height:8pt;width:60pt}.card span{font-size:7pt}code{font-size:6pt}
 .wide{overflow:visible}tr{break-inside:avoid}table{break-inside:auto}}
"""

WIDTH, HEIGHT = 120.0, 14.0
"""Of the picture of a figure."""

MARGIN = 0.25
"""Of the range between the limits, to each side of them."""


@dataclass(frozen=True)
class Certificate:
    """Who tested which motor when, by what, and the verdict.

    type_file, type_sha256: the file of the motor type; findings: of the results, as
    (analysis, severity, name), but for notes.
    """

    motor_type: MotorType
    type_file: str
    type_sha256: str
    serial: str
    operator: str
    time: datetime
    version: str
    verdict: MotorVerdict
    recordings: tuple[UsedRecording, ...]
    findings: tuple[tuple[str, str, str], ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return all of it as JSON has it."""
        return {
            "schema": SCHEMA,
            "decision": self.verdict.decision,
            "motor": self.motor_type.motor,
            "serial": self.serial,
            "motor_type": {"file": self.type_file, "sha256": self.type_sha256},
            "operator": self.operator,
            "time": self.time.isoformat(),
            "version": self.version,
            "risk_percent": self.motor_type.risk_percent,
            "nonconformance_bound": self.verdict.nonconformance_bound,
            "figures": encode(self.verdict.figures),
            "recordings": encode(self.recordings),
            "findings": [
                dict(zip(("analysis", "severity", "name"), one, strict=True))
                for one in self.findings
            ],
        }

    def page(self) -> Page:
        """Return the page."""
        decision = self.verdict.decision
        page = Page(
            f"{self.motor_type.motor}, serial {self.serial}: {decision}",
            "Verdict of conformity by the uncertainty of the measurement (JCGM 106, ISO 14253-1)",
            _STYLE,
        )
        page.cards([(decision.upper(), "verdict"), *self._facts()])
        page.heading("Figures")
        page.table(
            ("figure", "low", "high", "value and U (95 %)", "conforms", "decision", ""),
            [_row(one) for one in self.verdict.figures],
            numbers=True,
        )
        page.points(list(self._remarks()))
        page.heading("Recordings")
        page.table(
            ("file", "plan", "begun (UTC)", "SHA-256"),
            [
                (
                    Verbatim(_short(one.path)),
                    _plan(one),
                    one.start.replace("T", " "),
                    Markup(f"<code>{one.sha256}</code>"),
                )
                for one in self.recordings
            ],
        )
        return page

    def _facts(self) -> list[tuple[str, str]]:
        return [
            (Verbatim(self.serial), "serial number"),
            (f"{self.time:%Y-%m-%d %H:%M:%S %Z}", "tested"),
            (Verbatim(self.operator), "by"),
        ]

    def _remarks(self) -> Iterator[str]:
        risk = f"{self.motor_type.risk_percent:g} %"
        yield (
            f"A figure passes if the probability that it lies within its limits is at least 100 % "
            f"less the risk of {risk}, and fails if it lies beyond one of them with that "
            "probability; else it is undecidable."
        )
        bound = self.verdict.nonconformance_bound
        if self.verdict.decision == "pass" and bound is not None:
            yield f"That any figure lies outside has a probability of at most {percent_up(bound)}."
        yield (
            "Pictures: a limit is a line; within the darker part a value passes; the mark is the "
            "value, with U."
        )
        yield from self.verdict.reasons()
        for analysis, severity, name in self.findings:
            yield f"{analysis}: {severity} {name}"
        for one in self.recordings:
            if one.damage:
                yield f"{_short(one.path)}: {one.damage}"
        yield (
            f"Motor type {_short(self.type_file)}, SHA-256 {self.type_sha256}; "
            f"motord {self.version}."
        )


def _short(path: str) -> str:
    return path.rpartition("/")[2]


def _plan(one: UsedRecording) -> str:
    return f"{one.plan}, calibration {one.calibration}" if one.calibration else one.plan


def _row(one: FigureVerdict) -> tuple[str, ...]:
    return (
        label(one.figure),
        "" if one.tolerance.low is None else f"{one.tolerance.low:.12g}",
        "" if one.tolerance.high is None else f"{one.tolerance.high:.12g}",
        measured(one),
        "" if one.probability is None else percent(one.probability),
        Markup(f'<span class="decision {one.decision}">{one.decision}</span>'),
        Markup(bar(one)),
    )


def label(figure: Figure) -> str:
    """Return analysis, name and unit of a figure."""
    return f"{figure.label} ({figure.unit})" if figure.unit else figure.label


def measured(one: FigureVerdict) -> str:
    """Return value and expanded uncertainty as text, as far as they are known."""
    value, half = one.figure.value, one.figure.expanded_uncertainty
    if value is None:
        return "none"
    return f"{value:.5g}" if half is None else plus_minus(value, half)


def percent(probability: float) -> str:
    """Return a probability in percent, of one near 1 what is missing: neither rounds to certain."""
    if probability > 0.9995:
        return "> 99.95 %"
    return "< 0.05 %" if probability < 0.0005 else f"{100 * probability:.1f} %"


def percent_up(bound: float) -> str:
    """Return what a probability is at most, in percent: it is rounded up."""
    return "0.05 %" if bound < 0.0005 else f"{ceil(1000 * bound - 1e-9) / 10:.1f} %"


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
