"""The report of an efficiency map: contours, losses, all figures, and what makes them uncertain."""

from motord.experiments.subject import Recordings
from motord.experiments.torque_speed.plots import efficiency_contours, losses
from motord.experiments.torque_speed.result import EfficiencyMap, OperatingPower
from motord.intervals import two_digits
from motord.report.html import Page

HEADER = ("set-points", "mechanical (W)", "electrical (W)", "losses (W)", "efficiency (%)")


def report(found: EfficiencyMap, recordings: Recordings) -> Page:
    """Return a page of its own."""
    page = Page("Efficiency map", recordings.subject.lead)
    if best := found.best:
        highest = best.efficiency.text()
        page.cards(
            [
                (f"{highest} %", f"highest efficiency, at {best.label}"),
                (f"{len(found.points)}", "operating points"),
            ]
        )
    page.table([], recordings.facts)
    page.heading("Efficiency over torque and speed")
    page.picture(
        efficiency_contours(found.points),
        "Efficiency of motor and inverter: mechanical over electrical power where it motors, "
        "electrical over mechanical where it generates. Dots: operating points, crosses: no "
        "efficiency is stated; between points the losses are taken to be straight. Dashed: the "
        "largest torque that the plan had for a speed, where the recordings say it.",
    )
    page.heading("Losses")
    page.picture(
        losses(found.points),
        "Electrical less mechanical power over torque, with 95 % intervals.",
    )
    page.heading("Operating points")
    page.paragraph(
        "Means over whole turns; powers are positive into the motor. Half-widths of 95 % "
        f"intervals. The electrical power is the channel {found.power_source}."
    )
    page.table(HEADER, [row(one) for one in found.points], numbers=True)
    reasons = [f"{one.label}: {one.efficiency_reason}" for one in found.points]
    page.points(
        [reason for one, reason in zip(found.points, reasons, strict=True) if one.efficiency_reason]
    )
    page.points([f"left out: {reason}" for reason in found.left_out])
    _fill_budget(page, found)
    return page


def row(one: OperatingPower) -> list[str]:
    """Return an operating point as a row under HEADER."""
    return [
        one.label,
        one.mechanical.text(),
        one.electrical.text(),
        one.loss.text(),
        one.efficiency.text() or "-",
    ]


def _fill_budget(page: Page, found: EfficiencyMap) -> None:
    best = found.best or found.points[0]
    page.heading("What makes it uncertain")
    page.paragraph(
        f"Standard uncertainties at {best.label}: {best.blocks} blocks of turns, {best.readings} "
        f"readings of the power, {best.read_every_s:.3g} s apart."
    )
    page.table(
        ["source", "type", "losses (W)", "efficiency (%)"],
        [
            [
                one.source,
                one.type,
                two_digits(one.loss_W),
                "-" if one.efficiency_percent is None else two_digits(one.efficiency_percent),
            ]
            for one in best.budget
        ],
        numbers=True,
    )
