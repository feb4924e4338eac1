"""Back-EMF from recordings of a driven rotor: result, table file, content of the report."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from motord.config import SEQUENCE
from motord.experiments.back_emf.estimate import MeasuredBackEmf, measure
from motord.experiments.back_emf.fit import VOLTAGES
from motord.experiments.back_emf.report import BackEmfReport, BackEmfRow
from motord.experiments.calibration.content import facts
from motord.experiments.driven_recordings import driven_points
from motord.experiments.subject import Subject
from motord.recording.reader import Run

SCHEMA = "motord.back-emf/1"

UNBALANCED = 0.002
"""Part of the fundamental by which a phase may differ from the mean of the three."""


def measured_back_emf(runs: Iterable[Run], subject: Subject) -> MeasuredBackEmf:
    """Return the back-EMF over all driven points. Raises AnalysisError, IdentifyError."""
    return measure(driven_points(runs, subject, VOLTAGES), subject.motor)


def back_emf_json(subject: Subject, runs: Sequence[str], found: MeasuredBackEmf) -> dict[str, Any]:
    """Return the result as it is written; `[motor] back_emf` may name the file.

    harmonics: mean of the phases, electrical orders in the convention of `[motor] back_emf`;
    phases: each phase's own lines, order per turn, amplitude sin(order theta + phase) with theta =
    2 pi count / counts.
    """
    motor = subject.motor
    return {
        "schema": SCHEMA,
        "bench": subject.bench,
        "motor": {
            "name": motor.name,
            "serial": motor.serial,
            "pole_pairs": motor.pole_pairs,
            "counts": motor.counts,
        },
        "runs": list(runs),
        "speeds_Hz": list(found.speeds_Hz),
        "turns": list(found.turns),
        "harmonics": _harmonics(found),
        "phases": {"abc"[phase]: _phase(found, phase) for phase in range(3)},
        "offset_V": found.offset_V.tolist(),
        "noise_V": found.noise_V.tolist(),
        "delay_s": None if found.delay_s is None else found.delay_s[0],
        "delay_stderr_s": None if found.delay_s is None else found.delay_s[1],
        "notes": notes(found),
        "k_V_s_per_rad": found.table().round(9).tolist(),
    }


def _electrical(found: MeasuredBackEmf) -> np.ndarray:
    """Return the places of the orders that are multiples of the pole pairs."""
    places: np.ndarray = np.flatnonzero(found.order % found.motor.pole_pairs == 0)
    return places


def balanced(found: MeasuredBackEmf) -> np.ndarray:
    """Return the mean of the phases, each turned back to phase a, at the electrical orders."""
    places = _electrical(found)
    harmonic = found.order[places] // found.motor.pole_pairs
    sequence = SEQUENCE[found.motor.phase_order]
    back = np.exp(2j * np.pi / 3 * sequence * np.outer(harmonic, np.arange(3)))
    line: np.ndarray = (found.line[places] * back).mean(axis=1)
    return line


def _harmonics(found: MeasuredBackEmf) -> list[dict[str, Any]]:
    motor, places = found.motor, _electrical(found)
    rows = []
    for place, line in zip(places, balanced(found), strict=True):
        order = int(found.order[place])
        turned = order * motor.encoder_offset_rad
        phase_rad = float(np.angle(1j * line * np.exp(-1j * turned)))
        stderr = float(np.sqrt((found.stderr[place] ** 2).sum()) / 3)
        sideways = found.phase_stderr[place] ** 2 - found.stderr[place] ** 2
        phase_stderr = float(np.hypot(stderr, np.sqrt(max(sideways.mean(), 0.0))))
        rows.append(
            {
                "order": order // motor.pole_pairs,
                "amplitude_V_s_per_rad": float(np.abs(line)),
                "phase_rad": phase_rad,
                "stderr_V_s_per_rad": stderr,
                "phase_stderr_rad": min(phase_stderr / max(float(np.abs(line)), 1e-300), np.pi),
                "in_table": bool(found.kept[place]),
            }
        )
    return rows


def _phase(found: MeasuredBackEmf, phase: int) -> list[dict[str, Any]]:
    return [
        {
            "order": int(found.order[place]),
            "amplitude_V_s_per_rad": float(np.abs(found.line[place, phase])),
            "phase_rad": float(np.angle(1j * found.line[place, phase])),
            "stderr_V_s_per_rad": float(found.stderr[place, phase]),
        }
        for place in np.flatnonzero(found.kept)
    ]


def notes(found: MeasuredBackEmf) -> list[str]:
    """Return what is worth knowing of the result, in words."""
    words = []
    places = _electrical(found)
    turned = np.exp(-2j * np.pi / 3 * SEQUENCE[found.motor.phase_order] * np.arange(3))
    own = found.line[places[0]]
    if abs((own * turned).mean()) > abs((own * turned.conj()).mean()):
        words.append(
            "phases b and c follow in the other order than [motor] says: change its phase_order, "
            "or encoder_direction (the plan `align` finds which); harmonics are a mean of the "
            "wrong phases, the table is right"
        )
    else:
        back = balanced(found)[0]
        apart = float(np.abs(own * turned.conj() - back).max() / np.abs(back))
        noise = 4 * float(found.stderr[places[0]].max() / np.abs(back))
        if apart > max(UNBALANCED, noise):
            words.append(
                f"a phase differs from the mean of the three by {100 * apart:.2f} % of the "
                "fundamental: use the table, not the harmonics"
            )
    if found.delay_s is None:
        words.append(
            "all speeds are alike: an age of the voltages that the recording does not tell would "
            "turn the waves, and cannot be seen; drive at speeds 1.3 times apart or more"
        )
    others = found.order[found.kept & (found.order % found.motor.pole_pairs != 0)]
    if others.size:
        listed = ", ".join(str(order) for order in others)
        words.append(f"orders per turn that are no multiple of the pole pairs: {listed}")
    return words


def back_emf_report(subject: Subject, runs: Sequence[str], found: MeasuredBackEmf) -> BackEmfReport:
    """Return the content of the report."""
    told = subject.motor.back_emf_table()
    return BackEmfReport(
        title="Back-EMF of a driven rotor",
        lead=f"{subject.motor.name} on bench {subject.bench}",
        facts=facts(None, subject, runs),
        pole_pairs=subject.motor.pole_pairs,
        k_V_s_per_rad=found.table(),
        told_V_s_per_rad=told,
        harmonics=tuple(
            BackEmfRow(
                order=row["order"],
                amplitude_V_s_per_rad=row["amplitude_V_s_per_rad"],
                phase_rad=row["phase_rad"],
                stderr_V_s_per_rad=row["stderr_V_s_per_rad"],
                in_table=row["in_table"],
            )
            for row in _harmonics(found)
        ),
        delay_s=found.delay_s,
        notes=tuple(notes(found)),
    )
