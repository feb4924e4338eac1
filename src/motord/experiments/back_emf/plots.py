"""Back-EMF: the phases over an electrical period, and their harmonics."""

import numpy as np
from matplotlib.figure import Figure

from motord.experiments.back_emf.result import MeasuredBackEmf
from motord.intervals import coverage_factor
from motord.report.style import AFTER, INK, OTHER, REFERENCE, SOFT, figure

PHASES = ((AFTER, "a"), (OTHER, "b"), (REFERENCE, "c"))


def waves(measured: np.ndarray, found: MeasuredBackEmf) -> Figure:
    """Return the table k (counts, 3) over a period, and the harmonics as bars."""
    configured, pole_pairs = found.motor.back_emf_table(), found.motor.pole_pairs
    with figure(3.2) as picture:
        left, right = picture.subplots(1, 2, width_ratios=[1.2, 1.0])
        counts = measured.shape[0]
        shown = min(-(-counts // pole_pairs) + 1, counts)
        degrees = 360.0 * pole_pairs * np.arange(shown) / counts
        for phase, (colour, name) in enumerate(PHASES):
            k = measured[:shown, phase]
            left.plot(degrees, k, color=colour, label=f"phase {name}", linewidth=1.8)
            left.plot(
                degrees, configured[:shown, phase], color=INK, linewidth=0.8, linestyle=(0, (4, 3))
            )
        left.set(xlim=(0, 360), xticks=range(0, 361, 60))
        left.set_xlabel("electrical angle from the zero point (degrees)")
        left.set_ylabel("back-EMF over speed (V s/rad)")
        picture.legend(*left.get_legend_handles_labels(), loc="outside upper left", ncols=3)
        harmonics = found.harmonics
        fundamental = harmonics[0].amplitude_V_s_per_rad
        order = [h.order for h in harmonics]
        percent = 100 * np.array([h.amplitude_V_s_per_rad for h in harmonics]) / fundamental
        noise = np.array(
            [coverage_factor(h.degrees_of_freedom) * h.stderr_V_s_per_rad for h in harmonics]
        )
        noise *= 100 / fundamental
        right.bar(order, percent, 0.7, color=AFTER)
        right.plot(order, noise, color=SOFT, linewidth=1.2, label="noise, 95 %")
        right.set(yscale="log", xlabel="electrical order", ylabel="amplitude (% of fundamental)")
        right.grid(visible=False, axis="x")
        right.legend(loc="upper right")
        return picture
