"""The page of `motord reproduce`: every figure and table of the report from our own data."""

from dataclasses import replace
from pathlib import Path

from motord.experiments.back_emf import report as back_emf
from motord.experiments.calibration import report as calibration
from motord.experiments.cogging import report as cogging_run
from motord.experiments.ilc import report as learn
from motord.experiments.inertia import report as inertia
from motord.experiments.ripple import report as ripple
from motord.experiments.sensitivity import report as sensitivity
from motord.report.html import Page
from motord.reproduce import cad_difference
from motord.reproduce.bench import true_estimate
from motord.reproduce.poels2008 import Row, as_json, chapters
from motord.reproduce.run import Results, save_summary

TITLE = "The report of Poels 2008, reproduced on the simulated rig"
LEAD = (
    "P.W. Poels, Cogging Torque Measurement, Moment of Inertia Determination and Sensitivity "
    "Analysis of an Axial Flux Permanent Magnet AC motor, TU/e DCT 2007.147. Every experiment was "
    "run on motord's simulated rig, recorded, and analysed from its recording."
)
NOT_REDRAWN = (
    "Figures 1.1, 2.1, 2.3, 3.1, 4.1 and 4.2 are photographs, CAD drawings and block diagrams of "
    "that rig, not data; they are not redrawn."
)


def write_page(folder: Path, found: Results, keep_recordings: bool) -> Path:
    """Write `reproduce.html` and `reproduce.json`; return the page's path. Raises OSError."""
    made = Page(TITLE, LEAD)
    rows = chapters(found)
    made.heading("The report's numbers, and ours")
    made.paragraph(
        "A difference stands with its reason, where there is one. What is true of a simulated rig "
        "is known, so errors here are errors against the truth; the report could only compare "
        "measurements with each other. " + NOT_REDRAWN
    )
    for name, ones in rows.items():
        made.subheading(name)
        _table(made, ones)
    _inertia(made, found)
    made.part("Chapter 3: cogging torque")
    cogging_run.fill(made, replace(found.cogging, comparison=found.comparison))
    back_emf.fill(made, found.back_emf)
    _calibration(made, found)
    made.part("Chapter 4: sensitivity of the calibration")
    sensitivity.fill(made, found.sensitivity)
    _remains(made, found)
    made.part("About these figures")
    made.facts(_facts(found, keep_recordings))
    path = folder / "reproduce.html"
    made.write(path)
    save_summary(folder / "reproduce.json", found, as_json(found))
    return path


def _table(made: Page, rows: list[Row]) -> None:
    made.table(
        ["section", "quantity", "report", "here", "why"],
        [[row.where, row.what, row.report, row.here, row.why] for row in rows],
    )


def _inertia(made: Page, found: Results) -> None:
    made.part("Chapter 2: moment of inertia")
    truth_kg_m2 = found.inertia_truth.rotor.inertia_kg_m2
    inertia.fill(made, found.oscillation, truth_kg_m2)
    cad_difference.fill(made)
    inertia.fill(made, found.acceleration, truth_kg_m2)


def _calibration(made: Page, found: Results) -> None:
    made.part("Chapter 4: calibration")
    joint, residual = found.calibrated.joint, found.calibrated.residual
    ripple.fill(made, joint.ripples, found.subject.motor)
    estimates = [("joint estimator", joint), ("the report's estimator", residual)]
    truth = true_estimate(found.truth, found.subject.motor.counts)
    calibration.fill(made, estimates, ("truth", truth))


def _remains(made: Page, found: Results) -> None:
    made.part("Chapter 4: what remains, and learning")
    titles = ("linear current sensors", "current sensors of \u00b10.7 %")
    for title, points in zip(titles, found.explained, strict=True):
        ripple.fill_shares(made, points, title)
    learn.fill(made, found.learned.passes[-1], found.learned.truth)


def _facts(found: Results, keep_recordings: bool) -> tuple[tuple[str, str], ...]:
    motor = found.subject.motor
    poles = 2 * motor.pole_pairs
    kept = "" if keep_recordings else " (not kept; --keep-recordings keeps them)"
    return (
        ("motor", f"{motor.name}, {motor.slots} slots, {poles} poles, {motor.counts} counts"),
        ("calibration", found.calibrated.calibration.id),
        ("recordings", ", ".join(run.name for run in found.runs) + kept),
        ("bench time", f"{found.bench_s:.0f} s, computed and analysed in {found.wall_s:.0f} s"),
    )
