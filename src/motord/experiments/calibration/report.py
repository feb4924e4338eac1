"""The report of a calibration: what it found, and the torque before and after it."""

from dataclasses import dataclass

import numpy as np

from motord.experiments.calibration.plots import Cogging, cogging
from motord.report.html import Page
from motord.report.plots.gains import Gains, gains
from motord.report.plots.mesh import Point, in_percent, rms_error
from motord.report.plots.torque import Ripple, over_angle_and_order


@dataclass(frozen=True)
class Estimate:
    """What one method, or the truth, says of the motor. Standard errors where there are any.

    alpha, beta_A (3,); tau_cog_Nm (counts,); order, amplitude_Nm (n,): its harmonics.
    """

    label: str
    alpha: np.ndarray
    beta_A: np.ndarray
    tau_cog_Nm: np.ndarray
    order: np.ndarray
    amplitude_Nm: np.ndarray
    alpha_stderr: np.ndarray | None = None
    beta_stderr_A: np.ndarray | None = None
    amplitude_stderr_Nm: np.ndarray | None = None

    @property
    def gains(self) -> Gains:
        """Its gains and offsets."""
        return Gains(self.label, self.alpha, self.beta_A, self.alpha_stderr, self.beta_stderr_A)

    @property
    def cogging(self) -> Cogging:
        """Its cogging torque."""
        return Cogging(
            self.label, self.tau_cog_Nm, self.order, self.amplitude_Nm, self.amplitude_stderr_Nm
        )


@dataclass(frozen=True)
class View:
    """The torque at one operating point, before and after; either may be missing."""

    label: str
    before: Ripple | None
    after: Ripple | None
    marked_orders: tuple[int, ...]


@dataclass(frozen=True)
class Shares:
    """RMS errors in percent by (torque_Nm, speed_Hz): measured, from the currents, and the rest."""

    measured: dict[Point, float]
    reconstructed: dict[Point, float]
    rest: dict[Point, float]


@dataclass(frozen=True)
class CalibrationReport:
    """All that goes into the page.

    facts: (name, value) rows about bench, motor and runs. before, after: RMS error in percent by
    (torque_Nm, speed_Hz), empty if not measured; `torque_meaning` says of which torque, such as
    "true torque". estimates: the one that is applied first. reference: truth or last calibration.
    """

    title: str
    lead: str
    facts: tuple[tuple[str, str], ...]
    torque_meaning: str
    before: dict[Point, float]
    after: dict[Point, float]
    view: View | None = None
    shares: Shares | None = None
    estimates: tuple[Estimate, ...] = ()
    reference: Estimate | None = None
    observable: tuple[str, ...] = ()


def page(data: CalibrationReport) -> Page:
    """Put the page together."""
    made = Page(data.title, data.lead)
    _key_figures(made, data)
    fill(made, data)
    made.heading("About these figures")
    if data.observable:
        made.points(data.observable)
    made.table((), data.facts)
    return made


def fill(made: Page, data: CalibrationReport) -> None:
    """Add ripple, gains and cogging torque to a page."""
    if data.before or data.after:
        _mesh(made, data)
    if data.view is not None:
        _torque(made, data.view)
    if data.shares is not None:
        fill_shares(made, data.shares)
    if data.estimates:
        _gains(made, data)
        _cogging(made, data)


def _key_figures(made: Page, data: CalibrationReport) -> None:
    figures = []
    for values, words in ((data.before, "before"), (data.after, "after")):
        if values:
            mean = sum(values.values()) / len(values)
            figures.append((f"{in_percent(mean)} %", f"mean RMS error {words} compensation"))
    if data.after:
        worst = max(data.after.values())
        figures.append((f"{in_percent(worst)} %", "at the worst operating point after"))
    if data.before and data.after:
        ratio = np.mean(list(data.before.values())) / np.mean(list(data.after.values()))
        figures.append((f"{ratio:.0f} \u00d7", "smoother on average"))
    if figures:
        made.cards(figures)


def _mesh(made: Page, data: CalibrationReport) -> None:
    made.heading("Torque ripple over the mesh")
    panels = [
        (title, values)
        for title, values in (
            ("Without compensation", data.before),
            ("With compensation", data.after),
        )
        if values
    ]
    made.picture(
        rms_error(panels),
        f"RMS error of the {data.torque_meaning}, Poels 2008, eq. (4.16), in percent of rated "
        "torque at each operating point. One scale for all; the line in it marks 1 %, the goal "
        "of that report, which reached 0.8 to 1.5 %.",
    )


def _torque(made: Page, view: View) -> None:
    made.heading(f"Torque at {view.label}")
    made.picture(
        over_angle_and_order(view.before, view.after, view.marked_orders),
        "The repeating part of the torque over one turn, without its mean, and its amplitude at "
        "each order. Numbered orders are multiples of the pole pairs: gains and cogging act at "
        "multiples of the pole number, offsets in between.",
    )


def fill_shares(made: Page, shares: Shares) -> None:
    """Add what of the ripple the currents explain (Poels 2008, Figures 4.10 and 4.11)."""
    made.heading("Where the ripple comes from")
    panels = [("Measured", shares.measured), ("From the currents", shares.reconstructed)]
    made.picture(
        rms_error([*panels, ("Rest", shares.rest)]),
        "RMS error of the measured torque (Poels 2008, Figure 4.10), of the torque reconstructed "
        "from the sensed currents with the calibration (Figure 4.11), and of the difference of "
        "the two. The second is what current control left; the third are errors of the current "
        "sensors and of the model, which no current shows.",
    )


def _gains(made: Page, data: CalibrationReport) -> None:
    made.heading("Phase gains and offsets")
    reference = data.reference.gains if data.reference else None
    made.picture(
        gains([e.gains for e in data.estimates], reference),
        "Dots are estimates, bars their 95 % intervals where they are wide enough to be seen.",
    )
    header = ["", *([data.reference.label] if data.reference else [])]
    header += [estimate.label for estimate in data.estimates]
    items = [*([data.reference] if data.reference else []), *data.estimates]
    rows = [
        [f"\u03b1 {phase}", *(_number(e.alpha, e.alpha_stderr, p, 4) for e in items)]
        for p, phase in enumerate("abc")
    ]
    rows += [
        [f"\u03b2 {phase} (A)", *(_number(e.beta_A, e.beta_stderr_A, p, 4) for e in items)]
        for p, phase in enumerate("abc")
    ]
    made.table(header, rows, numbers=True)


def _number(values: np.ndarray, stderr: np.ndarray | None, index: int, digits: int) -> str:
    text = f"{values[index]:.{digits}f}"
    if stderr is None:
        return text
    return f"{text} \u00b1 {1.96 * stderr[index]:.{digits}f}"


def _cogging(made: Page, data: CalibrationReport) -> None:
    made.heading("Cogging torque")
    reference = data.reference.cogging if data.reference else None
    made.picture(
        cogging([e.cogging for e in data.estimates], reference),
        "Cogging torque over a part of the turn, and its amplitude at the orders that slots and "
        "poles allow, with 95 % intervals.",
    )
    items = [*([data.reference] if data.reference else []), *data.estimates]
    orders = sorted({int(order) for item in items for order in item.order})
    rows = [[str(order), *(_amplitude(item, order) for item in items)] for order in orders]
    made.table(["order", *(f"{item.label} (mNm)" for item in items)], rows, numbers=True)


def _amplitude(item: Estimate, order: int) -> str:
    found = np.flatnonzero(item.order == order)
    if not found.size:
        return ""
    text = f"{1e3 * item.amplitude_Nm[found[0]]:.2f}"
    if item.amplitude_stderr_Nm is None:
        return text
    return f"{text} \u00b1 {1.96e3 * item.amplitude_stderr_Nm[found[0]]:.2f}"
