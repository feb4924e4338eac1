"""Pages of torque ripple over the mesh, before and after compensation, and where it comes from."""

from collections.abc import Mapping, Sequence

import numpy as np

from motord.calibration import RmsErrors, TorqueSpeed, by_magnitude
from motord.config import MotorConfig
from motord.experiments.ripple.estimate import (
    Explained,
    MeshRipple,
    compensated,
    middle_point,
)
from motord.experiments.subject import Recordings
from motord.identification.point_ripple import PointRipple, rms_errors
from motord.report.html import Page
from motord.report.plots.mesh import rms_error
from motord.report.plots.torque import TorqueCurve, over_angle_and_order
from motord.report.text import WHEN, largest_interval, with_interval

CURVE_ANGLES = 2048
"""Angles over one turn at which the torque is drawn."""

MEASURED = "measured torque, freed of noise and of the sensor's response"
"""Which torque the RMS errors of a report are of, unless it says otherwise."""

Errors = Mapping[TorqueSpeed, float]
"""RMS error in percent of rated torque by (torque_Nm, speed_Hz); empty if not measured."""


def report(found: MeshRipple, recordings: Recordings) -> Page:
    """Return the page of a verification."""
    page = Page("Verification of torque ripple", recordings.subject.lead)
    fill_key_figures(page, found.errors)
    fill(page, found.scaled, recordings.subject.motor)
    fill_shares(page, found.explained)
    page.heading("About these figures")
    page.facts(recordings.facts)
    return page


def fill(page: Page, ripples: Sequence[PointRipple], motor: MotorConfig) -> None:
    """Add the measured ripple of the points, and the torque at the point in the middle of them."""
    intervals = largest_interval(one.half_width_percent for one in ripples)
    fill_mesh(page, *before_and_after(ripples), intervals=intervals)
    before = {(p.torque_Nm, p.speed_Hz): p for p in ripples if p.compensate == 0}
    after = {(p.torque_Nm, p.speed_Hz): p for p in ripples if p.compensate != 0}
    places = sorted(before.keys() & after.keys() or before.keys() | after.keys())
    if not places:
        return
    torque_Nm, speed_Hz = place = middle_point(places)
    fill_torque(
        page,
        f"{torque_Nm:g} Nm, {speed_Hz:g} turns/s",
        _curve(before[place]) if place in before else None,
        _curve(after[place]) if place in after else None,
        range(motor.pole_pairs, 40 * motor.pole_pairs, motor.pole_pairs),
    )


def before_and_after(ripples: Sequence[PointRipple]) -> tuple[Errors, Errors]:
    """Return the RMS errors without and with compensation."""
    points = rms_errors(ripples).points
    before = {(p.torque_Nm, p.speed_Hz): p.before for p in points if p.before is not None}
    after = {(p.torque_Nm, p.speed_Hz): p.after for p in points if p.after is not None}
    return by_magnitude(before), by_magnitude(after)


def _curve(ripple: PointRipple) -> TorqueCurve:
    angle_rad = np.linspace(0, 2 * np.pi, CURVE_ANGLES + 1)
    return TorqueCurve(
        angle_rad=angle_rad,
        torque_Nm=ripple.torque_over(angle_rad),
        order=ripple.order,
        amplitude_Nm=np.abs(ripple.line_Nm),
        noise_Nm=ripple.noise_Nm,
    )


def fill_key_figures(page: Page, errors: RmsErrors, more: Sequence[tuple[str, str]] = ()) -> None:
    """Add mean errors and the largest, with compensation if there are, as key figures; `more`."""
    figures, largest = [], []
    for name, when in WHEN.items():
        if (found := getattr(errors, name)) is None:
            continue
        mean = with_interval(found.mean, found.mean_half_width, " %")
        figures.append((mean, f"mean RMS error {when}, 95 %"))
        worst = next(one for one in errors.points if getattr(one, name) == found.max)
        where = f"the largest {when}, at {worst.torque_Nm:g} Nm, {worst.speed_Hz:g} Hz, 95 %"
        largest = [(with_interval(found.max, found.max_half_width, " %"), where)]
    if figures or more:
        page.cards([*figures, *largest, *more])


def fill_mesh(
    page: Page,
    before: Errors,
    after: Errors,
    torque_meaning: str = MEASURED,
    intervals: str = "",
) -> None:
    """Add heat maps of the RMS errors, if there are any; torque_meaning: of which torque.

    intervals: a sentence on how well they are known.
    """
    panels = [("Without compensation", before), ("With compensation", after)]
    if not before and not after:
        return
    page.heading("Torque ripple over the mesh")
    page.picture(
        rms_error([(title, values) for title, values in panels if values]),
        f"RMS error of the {torque_meaning}, Poels 2008, eq. (4.16), in percent of rated "
        "torque at each operating point; where the mesh was taken in both directions, by the "
        "magnitudes of torque and speed. One scale for all; the line in it marks 1 %, the goal "
        f"of that report, which reached 0.8 to 1.5 %. {intervals}".rstrip(),
    )


def fill_torque(
    page: Page,
    label: str,
    before: TorqueCurve | None,
    after: TorqueCurve | None,
    marked_orders: Sequence[int],
) -> None:
    """Add the torque over a turn at one operating point, and its spectrum."""
    page.heading(f"Torque at {label}")
    page.picture(
        over_angle_and_order(before, after, marked_orders),
        "The repeating part of the torque over one turn, without its mean, and its amplitude at "
        "each order. Numbered orders are multiples of the pole pairs: gains and cogging act at "
        "multiples of the pole number, offsets in between.",
    )


def fill_shares(page: Page, points: Sequence[Explained], of: str = "") -> None:
    """Add what of the ripple the currents explain (Poels 2008, Figures 4.10 and 4.11), if known.

    Where there are points with compensation, of those alone. of: what they were taken with.
    """
    points = compensated(points)
    if not points:
        return
    at = [(p.measured.torque_Nm, p.measured.speed_Hz) for p in points]
    panels = [
        ("Measured", [p.sampled_percent for p in points]),
        ("From the currents", [p.reconstructed_percent for p in points]),
        ("Rest", [p.rest_percent for p in points]),
    ]
    page.heading(f"Where the ripple comes from{f': {of}' if of else ''}")
    page.picture(
        rms_error([(title, dict(zip(at, values, strict=True))) for title, values in panels]),
        "RMS error of the measured torque as it is sampled (Poels 2008, Figure 4.10), of the "
        "torque reconstructed from the sensed currents with the calibration (Figure 4.11), and of "
        "the difference of the two. The second is what current control left; the third are errors "
        "of the current sensors and of the model, which no current shows. 95 % intervals are "
        "not known.",
    )
