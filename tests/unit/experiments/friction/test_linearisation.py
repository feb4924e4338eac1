"""What a change of a coefficient does to the angle, against the rotor that is integrated so."""

from dataclasses import replace

import numpy as np
import pytest

from motord.experiments.friction.coast_down_rows import CoastDown, CoastDownRows
from motord.experiments.friction.linearisation import Linearisation
from tests.unit.experiments.friction.coasting import (
    INERTIA,
    STEP_S,
    Rotor,
    friction,
    of_seeds,
    paths,
)

ROTOR = Rotor(stribeck_Nm=0.01, stribeck_rad_s=5.0)
ORDERS = [order for order, _, _ in ROTOR.cogging]
PART = 1e-5
"""Of its own size, by which a coefficient is changed."""

STARTS_RAD, SPEEDS_RAD_S, STOP_RAD_S = np.array([0.3, 2.0]), np.array([12.0, 11.0]), 6.0

(_, C16, D16), (_, C48, D48) = ROTOR.cogging
CHANGED = {
    "Coulomb friction": replace(ROTOR, coulomb_Nm=ROTOR.coulomb_Nm * (1 + PART)),
    "viscous friction": replace(
        ROTOR, viscous_Nm_s_per_rad=ROTOR.viscous_Nm_s_per_rad * (1 + PART)
    ),
    "order 16": replace(ROTOR, cogging=((16, C16 * (1 + PART), D16), (48, C48, D48))),
    "order 48": replace(ROTOR, cogging=((16, C16, D16), (48, C48, D48 * (1 + PART)))),
}
COLUMNS = {"Coulomb friction": 0, "viscous friction": 1, "order 16": 2, "order 48": 5}


def angles_rad(rotor: Rotor, direction: int) -> list[np.ndarray]:
    """Return the angles of two coast-downs of a rotor."""
    return paths(rotor, STARTS_RAD, direction * SPEEDS_RAD_S, STOP_RAD_S)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("name", CHANGED)
def test_a_coefficient_changes_the_angle_as_the_rotor_is_integrated(
    name: str, direction: int
) -> None:
    both = zip(angles_rad(ROTOR, direction), angles_rad(CHANGED[name], direction), strict=True)
    pairs = [(a[: min(a.size, b.size)], b[: min(a.size, b.size)]) for a, b in both]
    coasts = [CoastDown(direction, STEP_S * np.arange(a.size), a) for a, _ in pairs]
    rows = CoastDownRows(tuple(coasts))
    solution = np.array(
        [ROTOR.coulomb_Nm, ROTOR.viscous_Nm_s_per_rad, C16, D16, C48, D48, ROTOR.stribeck_Nm]
    )
    around = Linearisation.around(
        rows, ORDERS, rows.q_rad, solution / INERTIA.kg_m2, ROTOR.stribeck_rad_s
    )
    columns = np.hstack([rows.friction(rows.q_rad), rows.cogging(ORDERS, rows.q_rad)])
    number = COLUMNS[name]
    found = around.changes(columns)[:, number] * solution[number] / INERTIA.kg_m2
    true = np.concatenate([direction * (b - a) / PART for a, b in pairs])
    assert found == pytest.approx(true, abs=2e-3 * np.abs(true).max())
    assert np.abs(columns[:, number] * solution[number] / INERTIA.kg_m2 - true).max() > 0.05 * (
        np.abs(true).max()
    )


def test_errors_of_the_cogging_torque_are_no_windage() -> None:
    """Recordings in which an error of the cogging torque, alike in all, looked like it."""
    for coasts in of_seeds([2, 3], Rotor(), 8, longest_step=1):
        found = friction(coasts)
        assert {finding.name for finding in found.findings} == {"one-direction"}


def test_cogging_torque_that_is_fitted_along_does_not_widen_intervals() -> None:
    with_cogging, without = (
        friction(next(of_seeds([5], rotor, 8, longest_step=1))).directions[0]
        for rotor in (Rotor(), Rotor(cogging=()))
    )
    assert with_cogging.coulomb_fit_Nm < 2 * without.coulomb_fit_Nm
