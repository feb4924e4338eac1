"""The report of learning: ripple over the mesh before and after, and pass by pass."""

from collections.abc import Mapping, Sequence

from motord.calibration import TorqueSpeed
from motord.experiments.ilc.analysis import LearnPass
from motord.experiments.ilc.order_list import in_lines
from motord.experiments.ilc.plots import convergence, corrections
from motord.experiments.subject import Recordings
from motord.report.html import Page
from motord.report.plots.mesh import rms_error


def report(done: LearnPass, _: Recordings | None = None) -> Page:
    """Return the page of a pass."""
    calibration = done.calibration
    lead = f"{calibration.motor.name}, calibration {calibration.id}"
    made = Page("Learning of torque ripple", lead)
    fill(made, done)
    return made


def fill(page: Page, done: LearnPass, truth: Sequence[Mapping[TorqueSpeed, float]] = ()) -> None:
    """Add headings and pictures to a page.

    truth: RMS error of the true torque in percent in every pass, the first with the calibration
    alone; by default the errors are those that the passes measured.
    """
    meaning = "measured torque, without noise and aliases," if not truth else "true torque"
    learned = {
        place: point for place, point in done.learned.by_place.items() if point.history_percent
    }
    passes = {place: point.history_percent for place, point in learned.items()}
    if truth:
        passes = {place: tuple(errors[place] for errors in truth) for place in truth[0]}
    panels = _panels(done, passes, measured=not truth)
    page.heading("Learning the residual torque ripple")
    page.picture(
        rms_error(panels),
        f"RMS error of the {meaning}, Poels 2008, eq. (4.16), in percent of rated "
        "torque at each operating point. One scale for all; the line in it marks 1 %.",
    )
    page.picture(
        convergence(passes),
        f"RMS error of the {meaning} in each pass, one line an operating point. The "
        "first pass has the calibration alone; each of the others has what was learned in those "
        "before it. A point that gains no more keeps its best correction. Lines at 1 and at 0.2 %.",
    )
    page.picture(
        corrections(done.learned.orders, learned),
        "Amplitude of the corrections at each order of the turn: dots are operating points, "
        "coloured by torque. Errors of the current sensors make torque at multiples of the pole "
        "pairs; other orders are there because the torque shows them.",
    )
    page.points([*done.reach, *in_lines(done.unreached)])
    page.table(
        ["", *(f"{title} (%)" for title, _ in panels)], _mean_and_worst(panels), numbers=True
    )


def _mean_and_worst(panels: Sequence[tuple[str, Mapping[TorqueSpeed, float]]]) -> list[list[str]]:
    """Return the rows of mean and largest RMS error, percent."""
    return [
        ["mean", *(f"{sum(errors.values()) / len(errors):.3f}" for _, errors in panels)],
        ["worst", *(f"{max(errors.values()):.3f}" for _, errors in panels)],
    ]


def _panels(
    done: LearnPass, passes: Mapping[TorqueSpeed, Sequence[float]], *, measured: bool
) -> list[tuple[str, dict[TorqueSpeed, float]]]:
    """Return title and RMS errors without compensation, calibrated and learned, where known."""
    panels = [
        ("Calibrated", {place: errors[0] for place, errors in passes.items()}),
        ("Learned", {place: errors[-1] for place, errors in passes.items()}),
    ]
    points = done.calibration.rms_error_percent.points
    before = {(p.torque_Nm, p.speed_Hz): p.before for p in points if p.before is not None}
    return [("Without compensation", before), *panels] if measured and before else panels
