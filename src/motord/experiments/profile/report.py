"""The report of a profile: torque and speed over time, errors, energy."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from motord.experiments.profile.result import Cycle, ProfileTracking
from motord.experiments.subject import Recordings
from motord.intervals import significant
from motord.report.html import Page
from motord.report.style import AFTER, BEFORE, GRID, INK, SOFT, figure

HEADER = (
    "cycle", "speed error RMS (turns/s)", "max (turns/s)", "in band (%)", "torque error RMS (Nm)",
    "max (Nm)", "in band (%)", "energy (J)", "asked (J)",
)  # fmt: skip
"""Of the table of cycles: errors of speed and torque, share of the time in tolerance, energy."""

DOTS_MAX = 20_000
"""Dots of a picture at most: each takes 150 bytes of the page."""

MEASURED = "measured"
WANTED = "profile"


def report(found: ProfileTracking, recordings: Recordings) -> Page:
    """Return the page of a profile that was played."""
    page = Page("Profile of torque and speed", recordings.subject.lead)
    page.cards(
        [
            (found.speed_rms_Hz.text(" turns/s"), "speed error, RMS"),
            (found.torque_rms_Nm.text(" Nm"), "torque error, RMS"),
            (found.energy_J.text(" J"), "mechanical energy of a cycle"),
        ]
    )
    page.heading("Torque and speed over time")
    page.picture(
        over_time(found.cycles[0]),
        f"Cycle {found.cycles[0].cycle}: what the profile asks for (thick line), the mean of what "
        "was measured and, shaded, its range within each span: mostly ripple.",
    )
    page.heading("Errors")
    page.picture(
        errors(found.cycles, found.speed_tolerance_Hz, found.torque_tolerance_Nm),
        "Measured less asked for, all cycles, means over each span; shaded: the tolerances, "
        f"{found.speed_tolerance_Hz:g} turns/s and {found.torque_tolerance_Nm:g} Nm. The table has "
        "RMS and largest error of speed and torque, the share of the time within the tolerance, "
        "and the mechanical energy. The RMS of the torque is without its white noise.",
    )
    page.table(HEADER, cycle_rows(found), numbers=True)
    page.heading("Over torque and speed")
    page.picture(
        over_plane(found.cycles),
        f"Torque over speed: the profile (line) and all cycles (dots, {DOTS_MAX} of them at most).",
    )
    page.heading("Energy and means of a cycle")
    page.table(("mean over the cycles, 95 % interval", ""), mean_rows(found), numbers=True)
    page.points(found.notes)
    page.heading("About these figures")
    rows = [("profile", found.file), ("SHA-256 of its content", found.sha256)]
    page.facts([*recordings.facts, *rows])
    return page


def cycle_rows(found: ProfileTracking) -> list[list[str]]:
    """Return a row of figures for each cycle."""
    return [
        [
            str(one.cycle),
            f"{one.speed.rms:.4f}",
            f"{one.speed.max:.3f}",
            f"{one.speed.within_percent:.1f}",
            significant(one.torque.rms, 3),
            significant(one.torque.max, 3),
            f"{one.torque.within_percent:.1f}",
            significant(one.energy_J, 4),
            significant(one.energy_wanted_J, 4),
        ]
        for one in found.cycles
    ]


def mean_rows(found: ProfileTracking) -> list[list[str]]:
    """Return name and value of each mean."""
    return [
        ["mechanical energy (J)", found.energy_J.text()],
        ["mechanical power (W)", found.power_mean_W.text()],
        ["torque (Nm)", found.torque_mean_Nm.text()],
        ["speed (turns/s)", found.speed_mean_Hz.text()],
        ["speed error, RMS (turns/s)", found.speed_rms_Hz.text()],
        ["torque error, RMS (Nm)", found.torque_rms_Nm.text()],
    ]


def over_time(cycle: Cycle) -> Figure:
    """Return speed and torque of a cycle over time, with what was asked for."""
    series = cycle.series
    with figure(5.0) as picture:
        upper, lower = picture.subplots(2, 1, sharex=True)
        for axes, spans in ((upper, series.speed_Hz), (lower, series.torque_Nm)):
            axes.fill_between(
                series.t_s, spans.low, spans.high, color=AFTER, alpha=0.3, linewidth=0,
                label="its range",
            )  # fmt: skip
            axes.plot(series.t_s, spans.wanted, color=INK, linewidth=2.4, label=WANTED)
            axes.plot(series.t_s, spans.measured, color=AFTER, linewidth=1.1, label=MEASURED)
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
            t_s, speed_Hz, torque_Nm = one.series.t_s, one.series.speed_Hz, one.series.torque_Nm
            upper.plot(t_s, speed_Hz.error, color=AFTER, linewidth=0.8, alpha=0.7)
            lower.plot(t_s, torque_Nm.error, color=BEFORE, linewidth=0.8, alpha=0.7)
        upper.set_ylabel("speed error (turns/s)")
        lower.set(xlabel="time of the profile (s)", ylabel="torque error (Nm)")
        return picture


def over_plane(cycles: Sequence[Cycle]) -> Figure:
    """Return torque over speed, asked for and measured."""
    with figure(4.0) as picture:
        axes = picture.subplots()
        speed_Hz = np.concatenate([one.series.speed_Hz.measured for one in cycles])
        torque_Nm = np.concatenate([one.series.torque_Nm.measured for one in cycles])
        shown = np.linspace(0, speed_Hz.size - 1, min(speed_Hz.size, DOTS_MAX)).astype(int)
        axes.plot(
            speed_Hz[shown], torque_Nm[shown], ".", color=AFTER, markersize=2.5, alpha=0.6,
            label=MEASURED,
        )  # fmt: skip
        series = cycles[0].series
        axes.plot(series.speed_Hz.wanted, series.torque_Nm.wanted, color=INK, label=WANTED)
        for line in (axes.axhline, axes.axvline):
            line(0, color=SOFT, linewidth=0.8, zorder=0)
        axes.set(xlabel="speed (turns/s)", ylabel="torque (Nm)")
        drawn = axes.get_legend_handles_labels()
        picture.legend(*drawn, loc="outside upper left", ncols=2, markerscale=4.0)
        return picture
