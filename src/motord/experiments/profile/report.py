"""The report of a profile: torque and speed over time, errors, energy."""

from motord.experiments.profile.plots import errors, over_plane, over_time
from motord.experiments.profile.result import ProfileTracking
from motord.experiments.subject import Recordings
from motord.report.html import Page


def report(found: ProfileTracking, recordings: Recordings) -> Page:
    """Return the page of a profile that was played."""
    page = Page("Profile of torque and speed", recordings.subject.lead)
    page.cards(
        [
            (f"{found.speed_rms_Hz.value:.3g} turns/s", "speed error, RMS"),
            (f"{found.torque_rms_Nm.value:.3g} Nm", "torque error, RMS"),
            (f"{found.energy_J.text()} J", "mechanical energy of a cycle"),
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
        "and the mechanical energy.",
    )
    page.table(HEADER, cycle_rows(found), numbers=True)
    page.heading("Over torque and speed")
    page.picture(
        over_plane(found.cycles), "Torque over speed: the profile (line) and all cycles (dots)."
    )
    page.heading("Energy and means of a cycle")
    page.table(("mean over the cycles, 95 % interval", ""), mean_rows(found), numbers=True)
    page.points(found.notes)
    page.heading("About these figures")
    rows = [("profile", found.file), ("SHA-256 of its content", found.sha256)]
    page.table((), [*recordings.facts, *rows])
    return page


HEADER = ("cycle", "Hz RMS", "Hz max", "in %", "Nm RMS", "Nm max", "in %", "J", "J asked")
"""Of the table of cycles: errors of speed and torque, share of the time in tolerance, energy."""


def cycle_rows(found: ProfileTracking) -> list[list[str]]:
    """Return a row of figures for each cycle."""
    return [
        [
            str(one.cycle),
            f"{one.speed.rms:.4f}",
            f"{one.speed.max:.3f}",
            f"{one.speed.within_percent:.1f}",
            f"{one.torque.rms:.3f}",
            f"{one.torque.max:.3f}",
            f"{one.torque.within_percent:.1f}",
            f"{one.energy_J:.1f}",
            f"{one.energy_wanted_J:.1f}",
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
