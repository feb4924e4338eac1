"""Pictures of a profile that was played: over time, errors, and over torque and speed."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.experiments.profile.result import Cycle, CycleSeries
from motord.report.style import AFTER, BEFORE, GRID, INK, SOFT, figure

MEASURED = "measured"
WANTED = "profile"


def over_time(cycle: Cycle) -> Figure:
    """Return speed and torque of a cycle over time, with what was asked for."""
    series = cycle.series
    with figure(5.0) as picture:
        upper, lower = picture.subplots(2, 1, sharex=True)
        _with_range(
            upper,
            series.t_s,
            series.speed_wanted_Hz,
            (series.speed_Hz, series.speed_low_Hz, series.speed_high_Hz),
        )
        _with_range(
            lower,
            series.t_s,
            series.torque_wanted_Nm,
            (series.torque_Nm, series.torque_low_Nm, series.torque_high_Nm),
        )
        upper.set_ylabel("speed (turns/s)")
        lower.set(xlabel="time of the profile (s)", ylabel="torque (Nm)")
        picture.legend(*upper.get_legend_handles_labels(), loc="outside upper left", ncols=3)
        return picture


def errors(
    cycles: Sequence[Cycle], speed_tolerance_Hz: float, torque_tolerance_Nm: float
) -> Figure:
    """Return the errors of all cycles over time, with the tolerances."""
    with figure(3.8) as picture:
        upper, lower = picture.subplots(2, 1, sharex=True)
        upper.axhspan(-speed_tolerance_Hz, speed_tolerance_Hz, color=GRID, zorder=0)
        lower.axhspan(-torque_tolerance_Nm, torque_tolerance_Nm, color=GRID, zorder=0)
        for one in cycles:
            series = one.series
            speed_Hz = series.speed_Hz - series.speed_wanted_Hz
            torque_Nm = series.torque_Nm - series.torque_wanted_Nm
            upper.plot(series.t_s, speed_Hz, color=AFTER, linewidth=0.8, alpha=0.7)
            lower.plot(series.t_s, torque_Nm, color=BEFORE, linewidth=0.8, alpha=0.7)
        upper.set_ylabel("speed error (turns/s)")
        lower.set(xlabel="time of the profile (s)", ylabel="torque error (Nm)")
        return picture


def over_plane(cycles: Sequence[Cycle]) -> Figure:
    """Return torque over speed, asked for and measured."""
    with figure(4.0) as picture:
        axes = picture.subplots()
        for number, one in enumerate(cycles):
            series: CycleSeries = one.series
            axes.plot(
                series.speed_Hz, series.torque_Nm, ".", color=AFTER, markersize=2.5, alpha=0.6,
                label=MEASURED if number == 0 else None,
            )  # fmt: skip
        series = cycles[0].series
        axes.plot(series.speed_wanted_Hz, series.torque_wanted_Nm, color=INK, label=WANTED)
        for line in (axes.axhline, axes.axvline):
            line(0, color=SOFT, linewidth=0.8, zorder=0)
        axes.set(xlabel="speed (turns/s)", ylabel="torque (Nm)")
        picture.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
        return picture


def _with_range(
    axes: Axes,
    t_s: np.ndarray,
    wanted: np.ndarray,
    measured: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """Draw what was asked for (n,), and mean, low and high of what was measured, each (n,)."""
    mean, low, high = measured
    axes.fill_between(t_s, low, high, color=AFTER, alpha=0.3, linewidth=0, label="its range")
    axes.plot(t_s, wanted, color=INK, linewidth=2.4, label=WANTED)
    axes.plot(t_s, mean, color=AFTER, linewidth=1.1, label=MEASURED)
