"""Changes since a calibration, each with its interval, in parts of its limit."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from motord.experiments.check_calibration.result import Change
from motord.report.style import AFTER, BEFORE, SOFT, figure

ROW_IN = 0.24
"""Height of a row of the picture."""


def changes(found: Sequence[Change]) -> Figure:
    """Return the changes, one a row; those that are drift in another colour."""
    with figure(1.0 + ROW_IN * len(found)) as picture:
        axes = picture.subplots()
        for kind, colour in ((False, AFTER), (True, BEFORE)):
            rows = [(n, one) for n, one in enumerate(found) if one.drifted == kind]
            axes.errorbar(
                [one.value / one.limit for _, one in rows],
                [n for n, _ in rows],
                xerr=[one.half_width / one.limit for _, one in rows],
                fmt="o", color=colour, markersize=5, capsize=3, elinewidth=1.4,
            )  # fmt: skip
        for limit in (-1.0, 1.0):
            axes.axvline(limit, color=SOFT, linewidth=1.0, linestyle=(0, (4, 3)))
        axes.axvline(0.0, color=SOFT, linewidth=0.8)
        axes.set_yticks(np.arange(len(found)), [one.name for one in found])
        axes.set_ylim(len(found) - 0.4, -0.6)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("change in parts of its limit")
        return picture
