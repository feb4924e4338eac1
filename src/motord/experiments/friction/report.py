"""The report of a friction run: friction over speed, coast-downs with their fit, residuals."""

from math import pi, sqrt

from motord.experiments.friction.plots import coast_downs, friction_over_speed, residuals
from motord.experiments.friction.result import CurvePoint, Friction
from motord.experiments.subject import Recordings
from motord.intervals import plus_minus
from motord.report.html import Page

CURVE_HEADER = (
    "speed (rad/s)",
    "torque (mNm)",
    "standard uncertainty (mNm)",
    "half of the 95 % interval (mNm)",
)


def report(found: Friction, recordings: Recordings) -> Page:
    """Return a page of its own."""
    page = Page("Friction of the free rotor", recordings.subject.lead)
    page.table([], recordings.facts)
    page.heading("Friction torque over speed")
    page.picture(
        friction_over_speed(found.directions),
        "Friction torque (mNm) over speed in both directions of turning, from the coast-downs "
        "with their 95 % interval (shaded), over the speeds that were seen. Dashed: Coulomb "
        "friction alone. Right: half of that interval, and dashed the combined standard "
        "uncertainty, which is in the table of the points.",
    )
    page.table(
        ["95 % intervals", *(one.direction for one in found.directions)],
        found.part_rows,
        numbers=True,
    )
    page.points(found.notes)
    page.subheading("Points of the curve")
    page.table(
        CURVE_HEADER,
        [_curve_row(point) for point in found.curve],
        numbers=True,
    )
    _fill_coast_downs(page, found, recordings.subject.motor.counts)
    return page


def _fill_coast_downs(page: Page, found: Friction, counts: int) -> None:
    page.heading("Coast-downs")
    page.picture(
        coast_downs(found.directions),
        "Speed of the rotor without current, by the fit: cogging torque and current offsets make "
        "its ripple. Right: the angle (dots, every hundredth sample) with the fit through it.",
    )
    rounding_rad = 2 * pi / counts / sqrt(12)
    page.picture(
        residuals(found.directions, rounding_rad),
        "Measured angle less the fit, of each coast-down and as an RMS over all of them; shaded: "
        f"half a count of the encoder, whose rounding alone has an RMS of {1e3 * rounding_rad:.2g} "
        "mrad. What repeats from coast-down to coast-down is torque that the fit does not have.",
    )
    page.subheading("Torque without current that does no work over a turn")
    page.table(
        ["order per turn", *(f"{one.direction} (mNm)" for one in found.directions)],
        _cogging_rows(found),
        numbers=True,
    )


def _curve_row(point: CurvePoint) -> list[str]:
    torque, low, high = (1e3 * value for value in (point.torque_Nm, point.low_Nm, point.high_Nm))
    half = max(high - torque, torque - low)
    number, _, width = plus_minus(torque, half).partition(" +- ")
    stderr = "" if point.stderr_Nm is None else f"{1e3 * point.stderr_Nm:.2g}"
    return [f"{point.speed_rad_s:.4g}", number, stderr, width]


def _cogging_rows(found: Friction) -> list[list[str]]:
    by_direction = [
        {line.order: f"{1e3 * line.amplitude_Nm:.2f}" for line in one.cogging}
        for one in found.directions
    ]
    orders = sorted({order for lines in by_direction for order in lines})
    return [[str(order), *(lines.get(order, "") for lines in by_direction)] for order in orders]
