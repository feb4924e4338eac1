"""The page of a calibration: torque ripple, gains, offsets and cogging torque."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from motord.calibration import Calibration, CramerRao
from motord.experiments.calibration.estimate.comparison import CalibratedRuns, recorded_truth
from motord.experiments.calibration.estimate.result import WITHOUT_LINES, Estimate
from motord.experiments.ripple import report as ripple
from motord.experiments.subject import Recordings
from motord.identification.operating_points import good_points
from motord.intervals import plus_minus, significant, two_digits
from motord.report.html import Page
from motord.report.plots.gains import Gains, gains
from motord.report.style import AFTER, INK, OTHER, REFERENCE, figure
from motord.uncertainty_budget import QUANTITIES, Contribution, delta_epsilon_text, totals

Labelled = tuple[str, Estimate]

NEGLIGIBLE = 1e-3
"""Part of the combined uncertainty below which a contribution is shown as 0."""

COLOURS = (AFTER, OTHER)


def report(found: CalibratedRuns, recordings: Recordings) -> Page:
    """Return the page of a calibration, next to that of the other estimator and a reference.

    The reference is the calibration that was named to compare with, else the truth, if the
    recordings hold it.
    """
    c = found.calibration
    page = Page("Calibration of torque ripple", recordings.subject.lead)
    ripple.fill_key_figures(page, c.rms_error_percent, _predicted(c.cramer_rao))
    ripple.fill(page, found.result.ripples, recordings.subject.motor)
    other = found.by_other_estimator()
    results = [found.result, *([] if isinstance(other, str) else [other])]
    estimates = [(f"{each.method} estimator", each) for each in results]
    more = [added.order for added in c.added_orders]
    fill(page, estimates, _reference(found.other, recordings, more))
    if c.budget:
        _budget(page, c.budget)
    if c.cramer_rao:
        _cramer_rao(page, c.cramer_rao)
    _temperatures(page, recordings)
    page.heading("About these figures")
    page.points([*c.observable, WITHOUT_LINES, *([other] if isinstance(other, str) else [])])
    rows = [
        ("calibration", f"{c.id}, made {c.created:%Y-%m-%d %H:%M} UTC"),
        ("method", f"{c.method}, condition number {c.condition_number:.3g}"),
        ("delta epsilon", delta_epsilon_text(c.delta_epsilon, c.delta_epsilon_source, c.budget)),
    ]
    page.facts([*recordings.facts, *rows])
    return page


def _predicted(bound: CramerRao | None) -> list[tuple[str, str]]:
    if bound is None:
        return []
    left, upper = two_digits(bound.ripple_percent), two_digits(bound.ripple_upper_percent)
    return [(f"{left} %", f"predicted by errors of Type A, below {upper} % (95 %)")]


def _temperatures(page: Page, recordings: Recordings) -> None:
    """Add the motor's temperatures at each operating point, where there are any."""
    points = [p for run in recordings.runs for p in good_points(run.operating_points())]
    names = sorted({name for point in points for name in point.get("temperatures", ())})
    if not names:
        return
    page.heading("Temperatures of the motor")
    rows = [
        [
            f"{point['torque_Nm']:g} Nm, {point['speed_Hz']:g} Hz",
            *(_temperature(point.get("temperatures", {}).get(name, {})) for name in names),
        ]
        for point in points
    ]
    page.table(["operating point", *(f"{name}: mean, change (K)" for name in names)], rows)


def _temperature(span: Mapping[str, float | None]) -> str:
    mean_C, change_K = span.get("mean_C"), span.get("change_K")
    return "not known" if mean_C is None or change_K is None else f"{mean_C:.1f}, {change_K:.1f}"


def _budget(page: Page, contributions: Sequence[Contribution]) -> None:
    page.heading("Uncertainty budget")
    page.picture(
        budget(contributions),
        "Standard uncertainties by source; of three phases, and of all orders of the cogging "
        "torque, the largest. Type A is what the data show, Type B what the bench file states in "
        "[accuracy], or what is assumed. The intervals above are of Type A.",
    )
    of_data, others, both = totals(contributions)

    def sizes(one: Contribution) -> list[str]:
        sized = [(value(one), value(both)) for _, _, value in QUANTITIES]
        return [two_digits(u) if u > NEGLIGIBLE * whole else "0" for u, whole in sized]

    rows = [[one.source, one.type, one.limit_text, *sizes(one)] for one in contributions]
    for one, label in ((of_data, "A"), (others, "B"), (both, "A and B")):
        rows.append([one.source, label, "", *sizes(one)])
    factors = both.coverage_factors
    expanded = [
        two_digits(k * value(both)) for k, (_, _, value) in zip(factors, QUANTITIES, strict=True)
    ]
    rows.append(["expanded (95 %)", "", "", *expanded])
    rows.append(["coverage factor k", "", "", *(f"{k:.2f}" for k in factors)])
    columns = [f"{name} ({unit})" for name, unit, _ in QUANTITIES]
    page.table(["source", "type", "limit", *columns], rows, numbers=True)


def _cramer_rao(page: Page, found: CramerRao) -> None:
    page.heading("Cram\u00e9r-Rao bound")
    page.points([*found.to_text(), found.noise_text])
    rows = [
        [f"{one.quantity} ({one.unit or 1})", f"{one.bound:.2g}", f"{one.efficiency:.2f}"]
        for one in found.quantities
    ]
    page.table(["", "standard error at the bound", "efficiency"], rows, numbers=True)
    shares = [[one.source, f"{100 * one.share:.0f}"] for one in found.shares]
    page.table(["variance of the predicted ripple", "share (%)"], shares, numbers=True)


def _reference(
    other: Calibration | None, recordings: Recordings, more: Iterable[int]
) -> Labelled | None:
    if other is not None:
        return f"calibration {other.id}", Estimate.of_calibration(other)
    truth = recorded_truth(recordings.runs, recordings.subject, more)
    return None if truth is None else ("truth", truth)


def fill(page: Page, estimates: Sequence[Labelled], reference: Labelled | None = None) -> None:
    """Add gains, offsets and cogging torque; reference: the truth, or another calibration."""
    _gains(page, estimates, reference)
    _cogging(page, estimates, reference)


def _gains(page: Page, estimates: Sequence[Labelled], reference: Labelled | None) -> None:
    page.heading("Phase gains and offsets")
    page.picture(
        gains([_drawn(each) for each in estimates], _drawn(reference) if reference else None),
        "Dots are estimates, bars their 95 % intervals where they are wide enough to be seen.",
    )
    items = [*([reference] if reference else []), *estimates]
    rows = [
        [f"\u03b1 {phase}", *(_number(e.alpha, e.alpha_half_width, p) for _, e in items)]
        for p, phase in enumerate("abc")
    ]
    rows += [
        [f"\u03b2 {phase} (A)", *(_number(e.beta_A, e.beta_half_width_A, p) for _, e in items)]
        for p, phase in enumerate("abc")
    ]
    page.table(["", *(label for label, _ in items)], rows, numbers=True)


def _drawn(item: Labelled) -> Gains:
    label, e = item
    return Gains(label, e.alpha, e.beta_A, e.alpha_half_width, e.beta_half_width_A)


def _number(values: np.ndarray, half_width: np.ndarray | None, phase: int) -> str:
    if half_width is None:
        return f"{values[phase]:.4f}"
    return plus_minus(values[phase], half_width[phase])


def _cogging(page: Page, estimates: Sequence[Labelled], reference: Labelled | None) -> None:
    page.heading("Cogging torque")
    page.picture(
        cogging(estimates, reference),
        "Cogging torque over a part of the turn, and its amplitude at the orders that slots and "
        "poles allow, and at those that the data ask for, with 95 % intervals.",
    )
    items = [*([reference] if reference else []), *estimates]
    orders = sorted({h.order for _, item in items for h in item.harmonics})
    rows = [[str(order), *(_amplitude(item, order) for _, item in items)] for order in orders]
    page.table(["order", *(f"{label} (mNm)" for label, _ in items)], rows, numbers=True)


def _amplitude(item: Estimate, order: int) -> str:
    harmonic = next((h for h in item.harmonics if h.order == order), None)
    if harmonic is None:
        return ""
    if item.alpha_stderr is None:
        return significant(1e3 * abs(harmonic.amplitude_Nm), 3)
    return harmonic.in_mNm()


def cogging(estimates: Sequence[Labelled], reference: Labelled | None) -> Figure:
    """Return the torque over an eighth of a turn or more, and the amplitudes at each order."""
    with figure(3.4) as picture:
        left, right = picture.subplots(1, 2, width_ratios=[1.25, 1.0])
        span_deg = _span_deg([estimate for _, estimate in estimates])
        for row, estimate in reversed(list(enumerate(estimates))):
            _curve(left, estimate, span_deg, COLOURS[row % 2], 2.0 if row == 0 else 0.8, "-")
        if reference is not None:
            _curve(left, reference, span_deg, REFERENCE, 1.6, (0, (3, 2)))
        left.set(xlim=(0, span_deg), xlabel="mechanical angle (degrees)")
        left.set(ylabel="cogging torque (Nm)", title="Cogging torque")
        _harmonics(right, [each for _, each in estimates], reference[1] if reference else None)
        handles, labels = left.get_legend_handles_labels()
        picture.legend(handles[::-1], labels[::-1], loc="outside upper right", ncols=3)
        return picture


def budget(contributions: Sequence[Contribution]) -> Figure:
    """Return standard uncertainties by source, a column of bars for each quantity."""
    sources = [one.source for one in contributions]
    with figure(0.9 + 0.24 * len(sources)) as picture:
        columns = picture.subplots(1, len(QUANTITIES), sharey=True)
        for axes, (name, unit, value) in zip(columns, QUANTITIES, strict=True):
            colours = [AFTER if one.type == "A" else OTHER for one in contributions]
            axes.barh(sources, [value(one) for one in contributions], 0.7, color=colours)
            axes.axvline(value(totals(contributions)[2]), color=INK, linewidth=1.0)
            axes.grid(visible=False, axis="y")
            axes.set(xlabel=unit, title=name)
        columns[0].invert_yaxis()
        handles = [Patch(color=AFTER), Patch(color=OTHER), Line2D([], [], color=INK)]
        labels = ["Type A", "Type B", "combined"]
        picture.legend(handles, labels, loc="outside upper right", ncols=3)
        return picture


def _span_deg(estimates: Sequence[Estimate]) -> float:
    """Return how much of the turn to show: four periods of the lowest order."""
    lowest = min((min(h.order for h in e.harmonics) for e in estimates if e.harmonics), default=1)
    return 360.0 * min(4 / lowest, 1.0)


def _curve(
    axes: Axes, item: Labelled, span_deg: float, colour: str, width: float, dashes: Any
) -> None:
    label, estimate = item
    turn = np.append(estimate.tau_cog_Nm, estimate.tau_cog_Nm[0])
    degrees = np.linspace(0, 360, turn.size)
    shown = degrees <= span_deg + 360.0 / estimate.tau_cog_Nm.size
    x, y = degrees[shown], turn[shown]
    axes.plot(x, y, color=colour, linewidth=width, linestyle=dashes, label=label)


def _harmonics(axes: Axes, estimates: Sequence[Estimate], reference: Estimate | None) -> None:
    items = [*estimates, *([reference] if reference is not None else [])]
    colours = [*COLOURS[: len(estimates)], REFERENCE]
    orders = sorted({h.order for item in items for h in item.harmonics})
    place = {order: x for x, order in enumerate(orders)}
    width = 0.8 / len(items)
    for row, item in enumerate(items):
        x = np.array([place[h.order] for h in item.harmonics])
        x = x + width * (row - (len(items) - 1) / 2)
        amplitude_Nm = np.array([abs(h.amplitude_Nm) for h in item.harmonics])
        error = np.array([h.half_width_Nm or 0.0 for h in item.harmonics])
        axes.bar(
            x, amplitude_Nm, width, yerr=None if item.alpha_stderr is None else error,
            color=colours[row], ecolor=INK, error_kw={"elinewidth": 1.2, "capsize": 2.0},
        )  # fmt: skip
    axes.set_xticks(range(len(orders)), [str(order) for order in orders])
    if len(orders) > 10:
        axes.tick_params(axis="x", rotation=60)
    axes.grid(visible=False, axis="x")
    axes.set(xlabel="order (per turn)", ylabel="amplitude (Nm)", title="Harmonics")
