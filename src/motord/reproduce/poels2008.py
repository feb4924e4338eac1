"""Comparison with Poels 2008: its figures, tables and numbers, ours, and why they differ.

All numbers in the column of the report are those that Poels 2008 prints.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from motord.experiments.inertia.oscillation import POELS2008_METHOD
from motord.experiments.ripple.estimate import Explained
from motord.intervals import plus_minus
from motord.reproduce.cad_difference import CAD_KG_M2, MEASURED_KG_M2, explanations
from motord.reproduce.run import Results

TABLE_4_2 = {
    "alpha": ((0.8000, 1.1180, 1.1180), (-3.5, -1.3, -2.6)),
    "beta": ((1.0, -0.5, -0.5), (0.1, 1.6, 24.1)),
}
"""Induced values, and errors of the calibrated ones in percent."""


@dataclass(frozen=True)
class Row:
    """One figure, table or number: what the report has, what was found, and why they differ."""

    where: str
    what: str
    report: str
    here: str
    why: str = ""


def chapters(found: Results) -> dict[str, list[Row]]:
    """Return the rows of each chapter, and of what goes beyond the report."""
    return {
        "Moment of inertia": [*_oscillation(found), *_acceleration(found)],
        "Cogging torque": [*_cogging(found), *_cogging_of_calibration(found)],
        "Calibration": list(_calibration(found)),
        "Sensitivity": [*_sensitivity(found), *_induced(found)],
        "What remains": list(_remains(found)),
        "Beyond the report": list(_beyond(found)),
    }


def as_json(found: Results) -> dict[str, Any]:
    """Return the rows for a file."""
    return {"beside": {name: [asdict(r) for r in rows] for name, rows in chapters(found).items()}}


def _oscillation(found: Results) -> Iterator[Row]:
    one, truth = found.oscillation, found.inertia_truth.rotor.inertia_kg_m2
    own = next(r for r in one.readings if r.label == POELS2008_METHOD)
    yield Row(
        "2.2.3",
        "inertia by oscillation",
        f"{MEASURED_KG_M2:g} kg m\u00b2; CAD {CAD_KG_M2:g}, so {_percent(0.066)} apart",
        plus_minus(one.inertia_kg_m2, one.half_width_kg_m2, "\u00b1")
        + f" kg m\u00b2; true {truth:g}, so {_percent(one.inertia_kg_m2 / truth - 1, 3)} apart",
        "Here lengths, stiffness and masses are known exactly. There they were measured with a "
        "ruler, weights and a balance, which is what the stated uncertainty is made of.",
    )
    yield Row(
        "2.2.3",
        "the same oscillations by the report's method (five periods, m/3)",
        "-",
        f"{own.inertia_kg_m2:.6f} kg m\u00b2, {_percent(own.inertia_kg_m2 / truth - 1)} off",
        "At large amplitude the springs' lever shortens, and a spring's effective mass is a little "
        "more than a third of its own. Both are in the fit of the whole decay.",
    )
    yield Row(
        "2.2.3",
        "standard deviation of the releases",
        "0.0038 %",
        f"{_percent(own.std_kg_m2 / own.inertia_kg_m2, 3, signed=False)} by five periods",
        "Rounding of a 12-bit encoder alone makes more than the report's figure here; how it was "
        "averaged is not in the report.",
    )
    yield _difference_to_cad()


def _difference_to_cad() -> Row:
    explained = [
        f"{e.label}: {100 * e.interval[0]:+.1f} to {100 * e.interval[1]:+.1f} %, "
        f"{'yes' if e.explains else 'no'}"
        for e in explanations()
    ]
    return Row(
        "2.3, Figures 2.6 to 2.9",
        "6.6 % explained by tolerances of 3 % (springs), 0.5 % (lengths), 3 % (mass); 95 %",
        "conjointly, yes",
        "; ".join(explained),
        "It takes one error common to all springs, such as that of a force gauge. Six independent "
        "errors average out and explain about half of it.",
    )


def _acceleration(found: Results) -> Iterator[Row]:
    step = found.acceleration
    truth = found.truth.rotor.inertia_kg_m2
    found_kg_m2 = plus_minus(step.inertia_kg_m2, step.half_width_kg_m2, "\u00b1")
    yield Row(
        "2.2.1",
        "inertia by acceleration",
        "not done: damping neglected in (2.1) would spoil it",
        f"{found_kg_m2} kg m\u00b2 (true {truth:g}); by (2.1) {step.plain_kg_m2:.5f}",
        "With friction in the fit and the measured torque on the other side it works; the sensor's "
        "gain is then what limits it.",
    )


def _cogging(found: Results) -> Iterator[Row]:
    one = found.cogging
    strongest = one.order[np.argmax(one.amplitude_Nm * one.allowed)]
    yield Row(
        "3.3, (3.1), Figure 3.2",
        "main order",
        "48, and multiples of 16",
        f"{one.main_order} by slots and poles; strongest found {strongest}",
    )
    worst = [float(np.abs(one.error_percent(s)).max()) for s in one.speeds]
    yield Row(
        "Figure 3.4",
        "largest error of a speed against their average",
        "2.5 % of the peak",
        f"{max(worst):.2f} %",
        "The belt makes the speed ripple here, too, but the sensor's response is undone in time, "
        "not at a mean speed, so it does not matter.",
    )


def _cogging_of_calibration(found: Results) -> Iterator[Row]:
    c = found.comparison
    yield Row(
        "Figure 4.5",
        "cogging by calibration against cogging measured, in time",
        "8 %",
        f"{c.worst_percent:.2f} % of the peak",
        "The report's calibration gives some of the cogging torque to the gains, and takes the "
        "sensor's phase for the motor's.",
    )
    yield Row(
        "4.3",
        "the same, magnitude of the harmonics",
        "0.5 %",
        f"{np.abs(c.magnitude_percent).max():.2f} % at most",
    )
    yield Row(
        "4.3",
        "the same, phase",
        "0.5 encoder points at most",
        f"{np.abs(c.phase_points).max():.2f} encoder points at most",
    )


def _calibration(found: Results) -> Iterator[Row]:
    joint, residual = found.calibrated.joint, found.calibrated.residual
    truth = found.truth.inverter
    alpha = np.array(truth.alpha) / np.cbrt(np.prod(truth.alpha))
    for p, phase in enumerate("abc"):
        induced, errors = TABLE_4_2["alpha"]
        yield Row(
            "Table 4.2",
            f"\u03b1 {phase}, {induced[p]:g} induced",
            f"{errors[p]:+.1f} %",
            f"{_percent(joint.alpha[p] / alpha[p] - 1, 2)}; by the report's estimator "
            f"{_percent(residual.alpha[p] / alpha[p] - 1)}",
            "Gains and cogging torque live at the same orders; the report's estimator cannot "
            "separate them, one that uses several torques at once can."
            if p == 0
            else "",
        )
    for p, phase in enumerate("abc"):
        induced, errors = TABLE_4_2["beta"]
        off_A = joint.beta_A[p] - truth.beta_A[p]
        yield Row(
            "Table 4.2",
            f"\u03b2 {phase}, {induced[p]:g} A induced",
            f"{errors[p]:+.1f} %",
            f"{_percent(off_A / truth.beta_A[p], 2)} ({off_A:+.4f} A)",
            "" if p < 2 else "The report suspects an error in its first calibration.",
        )


def _sensitivity(found: Results) -> Iterator[Row]:
    theory = found.sensitivity.theory
    names = {"alpha_a": "\u03b1 a", "beta_a_A": "\u03b2 a", "cogging": "factor of cogging"}
    for what, name in names.items():
        low, high = theory.ends[what]
        yield Row(
            "Table 4.1, Figure 4.3",
            f"RMS error at the ends of the interval of {name}, {theory.torque_Nm:g} Nm",
            f"interval {low[0]:g} to {high[0]:g}",
            f"{low[1]:.2f} % and {high[1]:.2f} %",
            "The report shows colours without numbers. Its factor of cogging matters less than "
            "20 % of a gain, as here."
            if what == "cogging"
            else "",
        )
        within = theory.within[what]
        yield Row(
            "Figure 4.4",
            f"{name} alone stays below 1 %",
            "a surface, no numbers",
            f"from {within[0]:.3f} to {within[1]:.3f}",
        )


def _induced(found: Results) -> Iterator[Row]:
    figures = {
        "alpha_a": "Figure 4.6", "beta_a_A": "Figure 4.7", "cogging": "Figure 4.8",
        "delta_epsilon": "Figure 4.9",
    }  # fmt: skip
    for one in found.sensitivity.series:
        yield Row(
            figures[one.what],
            "largest difference of measured and theoretical RMS error",
            "slopes alike; the measured ones lie higher",
            f"{one.worst_difference_percent:.2f} % of rated, floor {one.floor_percent:.2f} %",
            "What the report calls residual, noise and what averaging left, is freed of noise "
            "here, so the floor is lower."
            if one.what == "alpha_a"
            else "",
        )
    again = found.sensitivity.again
    if again is not None:
        worst = 100 * np.abs(again.found.alpha / again.alpha - 1).max()
        yield Row(
            "Table 4.2",
            "induced on the calibrated bench and calibrated again, as the report did",
            "\u03b1 within 3.5 %, \u03b2 within 24 %",
            f"\u03b1 within {worst:.2f} %, \u03b2 within "
            f"{np.abs(again.found.beta_A - again.beta_A).max():.4f} A",
        )


def _remains(found: Results) -> Iterator[Row]:
    linear, nonlinear = found.explained
    yield Row(
        "Figure 4.10",
        "RMS error left after calibration",
        "0.8 to 1.5 %, goal 1 %",
        f"{_range(_measured(nonlinear))} with current sensors of \u00b10.7 %; "
        f"{_range(_measured(linear))} with linear ones",
        "So the sensors are what was left in the report, as it says.",
    )
    yield Row(
        "Figure 4.11",
        "RMS error of the torque reconstructed from the currents",
        "0.8 to 1.3 %, taken for sensors and control",
        f"{_range([p.reconstructed_percent for p in nonlinear])} with current sensors of "
        "\u00b10.7 %; not explained by the currents: "
        f"{_range([p.rest_percent for p in nonlinear])}",
        "A sensor does not show its own error. What the currents do show is the control's share; "
        "the sensors' is in the rest.",
    )


def _beyond(found: Results) -> Iterator[Row]:
    before, after = found.learned.before.values(), found.learned.after.values()
    yield Row(
        "-",
        "RMS error of the true torque after learning on top of the calibration",
        "-",
        f"{_range(list(after))}, before {_range(list(before))}, sensors of \u00b10.7 %",
        "Learning needs no model of what is wrong, only that it repeats.",
    )
    k = {h.order: h for h in found.truth.motor.back_emf}
    strength = found.back_emf.fundamental
    true = abs(k[1].amplitude_V_s_per_rad)
    yield Row(
        "-",
        "back-EMF, measured by driving the rotor",
        "used, not shown",
        f"fundamental {strength:.5f} V s/rad, true {true:g}: {_percent(strength / true - 1, 3)}",
    )


def _measured(points: Sequence[Explained]) -> list[float]:
    return [point.measured.rms_percent for point in points]


def _range(values: Sequence[float]) -> str:
    return f"{min(values):.2f} to {max(values):.2f} %"


def _percent(part: float, digits: int = 1, *, signed: bool = True) -> str:
    return f"{100 * part:{'+' if signed else ''}.{digits}f} %"
