"""The report of a cogging run: spectrum, cogging torque, error of each speed, a calibration's."""

import math
from dataclasses import dataclass

import numpy as np

from motord.experiments.cogging.plots import averaged, beside_calibration, errors, spectra
from motord.report.html import Page


@dataclass(frozen=True)
class HarmonicRow:
    """amplitude_Nm sin(order theta + phase_rad), its standard error, allowed by slots and poles."""

    order: int
    amplitude_Nm: float
    phase_rad: float
    stderr_Nm: float
    allowed: bool


@dataclass(frozen=True)
class SpeedRow:
    """One speed. spectrum_Nm (m,): amplitude of orders 1 to m; error_percent (counts,)."""

    speed_Hz: float
    turns: int
    speed_ripple_percent: float
    spectrum_Nm: np.ndarray
    error_percent: np.ndarray


@dataclass(frozen=True)
class Beside:
    """A calibration's cogging torque beside the measured one.

    tau_cog_Nm, error_percent (counts,), % of the measured peak; order, magnitude_percent (of each
    harmonic), phase_points (encoder points) (m,).
    """

    label: str
    tau_cog_Nm: np.ndarray
    error_percent: np.ndarray
    order: np.ndarray
    magnitude_percent: np.ndarray
    phase_points: np.ndarray


@dataclass(frozen=True)
class CoggingRunReport:
    """All that goes into the page. tau_cog_Nm (counts,) at angles 2 pi n / counts."""

    title: str
    lead: str
    facts: tuple[tuple[str, str], ...]
    slots: int
    poles: int
    main_order: int
    tau_cog_Nm: np.ndarray
    harmonics: tuple[HarmonicRow, ...]
    speeds: tuple[SpeedRow, ...]
    beside: Beside | None = None


def fill(page: Page, data: CoggingRunReport) -> None:
    """Add the cogging run to a page."""
    page.heading("Cogging torque, measured by driving the rotor")
    page.paragraph(
        f"{data.slots} slots and {data.poles} poles have their main order at {data.main_order} per "
        "turn, Q 2p / HCF(Q, 2p) (Poels 2008, eq. (3.1)). A slot out of place adds multiples of "
        f"{data.poles}, a magnet out of place multiples of {data.slots}."
    )
    page.picture(
        spectra([(_at(s), s.spectrum_Nm) for s in data.speeds], _allowed(data)),
        "Amplitude (Nm) at each order of the turn, at each speed, freed of the sensor's response "
        "(Poels 2008, Figure 3.2). Marked: the orders that slots and poles allow. What is between "
        "them is noise.",
    )
    page.picture(
        averaged(data.tau_cog_Nm, data.main_order),
        "Cogging torque (Nm) over a turn, averaged over the speeds (Poels 2008, Figure 3.3), and "
        "a part of it.",
    )
    _harmonics(page, data)
    page.picture(
        errors([(_at(s), s.error_percent) for s in data.speeds], _span_deg(data)),
        "Cogging torque at each speed less the average, in percent of the average's peak, over "
        "the part of the turn within which it repeats (Poels 2008, Figure 3.4, where it is up to "
        "2.5 %).",
    )
    page.table(
        ["speed (1/s)", "turns", "speed ripple (%)", "largest error (%)"],
        [
            [
                f"{s.speed_Hz:.4f}",
                str(s.turns),
                f"{s.speed_ripple_percent:.1f}",
                f"{np.abs(s.error_percent).max():.2f}",
            ]
            for s in data.speeds
        ],
        numbers=True,
    )
    if data.beside is not None:
        _beside(page, data, data.beside)


def page(data: CoggingRunReport) -> Page:
    """Return a page of its own."""
    made = Page(data.title, data.lead)
    made.table([], data.facts)
    fill(made, data)
    return made


def _at(speed: SpeedRow) -> str:
    return f"{speed.speed_Hz:.2g} /s"


def _span_deg(data: CoggingRunReport) -> float:
    """Return two of the parts of a turn that are all alike, the whole turn at most."""
    return 360.0 * min(2 / math.gcd(*_allowed(data)), 1.0)


def _allowed(data: CoggingRunReport) -> tuple[int, ...]:
    return tuple(h.order for h in data.harmonics if h.allowed)


def _harmonics(page: Page, data: CoggingRunReport) -> None:
    page.table(
        ["order", "amplitude (mNm)", "phase (rad)", "from"],
        [
            [
                str(h.order),
                f"{1e3 * h.amplitude_Nm:.3f} \u00b1 {1.96e3 * h.stderr_Nm:.3f}",
                f"{h.phase_rad:.4f}" if h.amplitude_Nm > 3 * h.stderr_Nm else "",
                _origin(h, data),
            ]
            for h in data.harmonics
        ],
        numbers=True,
    )


def _origin(harmonic: HarmonicRow, data: CoggingRunReport) -> str:
    if not harmonic.allowed:
        return "neither slots nor poles"
    if harmonic.order % data.main_order == 0:
        return "slots and poles"
    return "slot out of place" if harmonic.order % data.poles == 0 else "magnet out of place"


def _beside(page: Page, data: CoggingRunReport, beside: Beside) -> None:
    page.heading("Calibrated beside measured cogging torque")
    page.picture(
        beside_calibration(
            data.tau_cog_Nm, beside.tau_cog_Nm, beside.error_percent, _span_deg(data)
        ),
        f"Cogging torque of {beside.label} less the measured one, in percent of the measured peak "
        "(Poels 2008, Figure 4.5).",
    )
    worst = np.abs(beside.error_percent).max()
    magnitude = np.abs(beside.magnitude_percent).max() if beside.order.size else float("nan")
    points = np.abs(beside.phase_points).max() if beside.order.size else float("nan")
    page.table(
        ["largest difference", "here", "report"],
        [
            ["in time (% of peak)", f"{worst:.2f}", "8"],
            ["magnitude of a harmonic (%)", f"{magnitude:.2f}", "0.5"],
            ["phase of a harmonic (encoder points)", f"{points:.3f}", "0.5"],
        ],
        numbers=True,
    )
    page.table(
        ["order", "magnitude (%)", "phase (encoder points)"],
        [
            [str(int(order)), f"{m:+.3f}", f"{p:+.3f}"]
            for order, m, p in zip(
                beside.order, beside.magnitude_percent, beside.phase_points, strict=True
            )
        ],
        numbers=True,
    )
