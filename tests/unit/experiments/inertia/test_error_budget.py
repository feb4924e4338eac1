"""The budget: first order against Monte Carlo, the report's figures, its 6.6 %."""

from dataclasses import replace

import numpy as np
import pytest

from motord.experiments.inertia.error_budget import (
    budget,
    curves,
    improvements,
    one_spring_a_side,
    shorter_bar,
)
from motord.experiments.inertia.springs import Tolerances
from motord.reproduce.cad_difference import (
    DIFFERENCE,
    MEASURED_KG_M2,
    explanations,
    reports_setup,
)
from tests.unit.experiments.inertia.inertia_runs import nominal_setup

FREQUENCY_RAD_S = 47.0


def test_monte_carlo_confirms_the_first_order() -> None:
    found = budget(nominal_setup(), FREQUENCY_RAD_S, 0.01)
    assert found.std_kg_m2 == pytest.approx(found.uncertainty_kg_m2, rel=0.01)
    assert found.mean_kg_m2 == pytest.approx(found.inertia_kg_m2, rel=1e-3)
    low, high = found.interval_kg_m2
    assert (high - low) / 2 == pytest.approx(1.96 * found.std_kg_m2, rel=0.02)
    shares = [s.uncertainty for s in found.shares]
    assert shares == sorted(shares, reverse=True)
    assert found.shares[0].source == "spring constants"
    assert {s.source: s.inputs for s in found.shares}["levers"] == 3
    assert found.draws >= 100_000
    assert budget(nominal_setup(), FREQUENCY_RAD_S, 0.01) == found  # seeded


def test_errors_in_common_do_not_average_out() -> None:
    base = nominal_setup()
    own = budget(base, FREQUENCY_RAD_S, 0.0, draws=20_000)
    tolerances = replace(base.tolerances, stiffness_shared=1.0, lever_shared=1.0)
    common = budget(replace(base, tolerances=tolerances), FREQUENCY_RAD_S, 0.0, draws=20_000)
    by_own = {s.source: s.uncertainty for s in own.shares}
    by_common = {s.source: s.uncertainty for s in common.shares}
    ratio = by_common["spring constants"] / by_own["spring constants"]
    assert ratio == pytest.approx(np.sqrt(6), rel=0.01)
    assert by_common["levers"] / by_own["levers"] == pytest.approx(np.sqrt(3), rel=0.01)
    assert common.std_kg_m2 == pytest.approx(common.uncertainty_kg_m2, rel=0.02)


def test_without_tolerances_nothing_but_the_frequency_is_uncertain() -> None:
    found = budget(
        replace(nominal_setup(), tolerances=Tolerances()), FREQUENCY_RAD_S, 0.047, draws=20_000
    )
    whole = nominal_setup().stiffness_Nm / FREQUENCY_RAD_S**2
    assert found.uncertainty_kg_m2 == pytest.approx(2e-3 * whole, rel=0.02)
    assert [s.uncertainty for s in found.shares[1:]] == [0.0] * 5


def test_figures_2_6_to_2_9_end_where_the_reports_do() -> None:
    setup = reports_setup()
    shown = curves(setup, setup.frequency_rad_s(MEASURED_KG_M2))
    assert shown.stiffness_change.shape == (6, 21)
    assert shown.stiffness_change[:, -1] == pytest.approx(np.arange(1, 7) * 0.011, abs=2e-4)
    assert shown.stiffness_change[5, 0] == pytest.approx(-0.066, abs=5e-4)
    assert shown.lever_change[2, -1] == pytest.approx(0.019, abs=5e-4)
    assert shown.mass_change[[0, -1]] == pytest.approx([0.0098, -0.0098], abs=2e-4)
    at = int(np.argmin(np.abs(shown.factor - 0.4)))
    assert -0.07 < shown.factor_change[at] < -0.055
    assert shown.factor_change[0] == 0
    assert 0.340 < shown.wave_factor < 0.347  # each spring carries about twice its own mass


def test_the_reports_difference_lies_within_its_tolerances_if_errors_are_common() -> None:
    own, own_any, common, common_any = explanations(draws=50_000)
    assert pytest.approx(0.0665, abs=5e-4) == DIFFERENCE
    assert common.explains
    assert common.interval[0] < -0.066
    assert 0.02 < common.rarity < 0.05
    assert not own.explains
    assert own.rarity < 1e-3
    for found in (own, own_any, common, common_any):
        assert found.worst[0] < found.interval[0] < found.interval[1] < found.worst[1]
        assert found.worst[1] > DIFFERENCE
    assert common_any.interval[0] < -0.1  # a larger effective mass takes inertia away


def test_what_the_proposed_changes_bring() -> None:
    found = improvements(nominal_setup(), 0.0105, 1e-4, 0.048, 0.002)
    by_label = {i.label: i.uncertainty for i in found}
    assert by_label["one spring a side"] < by_label["as it is"]
    assert by_label["bar half as long"] < 0.8 * by_label["as it is"]
    assert by_label["no brake disc"] == pytest.approx(by_label["as it is"], rel=0.01)
    assert by_label["all three"] < by_label["as it is"]
    for improvement in found:
        assert improvement.budget.inertia_kg_m2 == pytest.approx(0.0105)


def test_one_spring_a_side_is_as_stiff_and_measured_to_as_many_newtons() -> None:
    base = nominal_setup()
    changed = one_spring_a_side(base)
    assert changed.stiffness_Nm == pytest.approx(base.stiffness_Nm)
    before = base.tolerances.stiffness * base.stiffness_N_per_m.mean()
    assert changed.tolerances.stiffness * changed.stiffness_N_per_m[0] == pytest.approx(before)
    weighed = base.tolerances.mass * base.mass_kg.sum()
    assert changed.tolerances.mass * changed.mass_kg.sum() == pytest.approx(weighed)
    short = shorter_bar(base, 0.5)
    assert short.tolerances.lever * short.levers_m[0] == pytest.approx(
        base.tolerances.lever * base.levers_m[0]
    )
    assert short.bar_inertia_kg_m2 == base.bar_inertia_kg_m2 / 8
