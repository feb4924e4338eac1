"""Releases of the simulated rig against its truth."""

from dataclasses import replace

import numpy as np
import pytest

from motord.experiments.inertia.oscillation import POELS2008_METHOD, combine
from motord.experiments.inertia.releases import read_release, waves_of
from motord.identification import IdentifyError
from tests.campaigns.inertia import covered, with_stator
from tests.unit.experiments.inertia.inertia_runs import (
    nominal_setup,
    read,
    releases,
    swing_bench,
    swing_truth,
    taken,
)

TRUTH_KG_M2 = swing_truth().rotor.inertia_kg_m2


def test_within_a_fifth_of_a_percent_of_the_truth() -> None:
    found = combine(releases(1, 6), nominal_setup())
    assert found.inertia_kg_m2 == pytest.approx(TRUTH_KG_M2, rel=2e-3)
    low, high = found.budget.interval_kg_m2
    assert low < TRUTH_KG_M2 < high
    assert 0.01 < found.budget.uncertainty_kg_m2 / TRUTH_KG_M2 < 0.03
    assert 0.04 < found.damping_ratio < 0.06


def test_the_reports_reading_is_high_by_amplitude_and_effective_mass() -> None:
    readings = {r.label: r for r in combine(releases(1, 6), nominal_setup()).readings}
    assert readings[POELS2008_METHOD].inertia_kg_m2 / TRUTH_KG_M2 - 1 == pytest.approx(
        0.016, abs=0.003
    )
    waves = readings["five periods, damped, waves in the springs"]
    assert waves.inertia_kg_m2 / TRUTH_KG_M2 - 1 == pytest.approx(0.0067, abs=0.002)
    small = readings["five periods, damped, at small amplitude, waves in the springs"]
    assert small.inertia_kg_m2 == pytest.approx(TRUTH_KG_M2, rel=2e-3)
    undamped = readings["five periods, damping neglected, m/3"]
    assert undamped.inertia_kg_m2 > readings[POELS2008_METHOD].inertia_kg_m2
    for reading in readings.values():
        assert 0 < reading.std_kg_m2 < 2e-3 * TRUTH_KG_M2


def test_the_stated_interval_covers_the_truth_of_misstated_set_ups() -> None:
    share = covered(releases(1, 6), draws=60, seed=3)
    assert 0.88 <= share <= 1.0


def test_a_release_that_was_disturbed_is_left_out() -> None:
    ticks = taken(swing_bench(), "inertia-oscillation", 1, repeats=3)
    late = ticks[1].copy()
    late["t_ns"][late.size // 2 :] += 4_000_000  # the clock, or the bar, stood still meanwhile
    read_all = [
        replace(read(n, block), label=f"run.mcap: release {n + 1}")
        for n, block in enumerate((ticks[0], late, ticks[2]))
    ]
    found = combine(read_all, nominal_setup())
    [left_out] = [one for one in found.findings if one.name == "releases-left-out"]
    assert left_out.meaning.startswith("run.mcap: release 2: left out")
    assert left_out.value > left_out.limit
    assert [release.index for release in found.disturbed] == [1]
    assert [release.index for release in found.releases] == [0, 2]
    assert found.inertia_kg_m2 == pytest.approx(TRUTH_KG_M2, rel=2e-3)
    assert not combine(releases(1, 6), nominal_setup()).disturbed


def test_no_release_and_too_heavy_a_bar_are_refused() -> None:
    with pytest.raises(IdentifyError, match="no good release"):
        combine([], nominal_setup())
    heavy = nominal_setup()
    object.__setattr__(heavy, "bar_inertia_kg_m2", 0.05)
    with pytest.raises(IdentifyError, match="bar and springs alone have more inertia"):
        combine(releases(1, 6)[:1], heavy)


def test_a_release_that_hardly_moves_is_refused() -> None:
    t_ns = np.arange(500) * 1_000_000
    with pytest.raises(IdentifyError, match="a release hardly moves"):
        read_release(3, t_ns, np.full(500, 7), 4096, nominal_setup())


def test_a_cogging_table_as_waves() -> None:
    angle_rad = 2 * np.pi * np.arange(4096) / 4096
    table_Nm = 0.3 * np.sin(48 * angle_rad + 0.4) + 0.1 * np.cos(16 * angle_rad)
    waves = waves_of(table_Nm)
    np.testing.assert_allclose(waves[0], [16, 48])
    np.testing.assert_allclose(waves[1:, 0], [0.1, 0.0], atol=1e-12)
    np.testing.assert_allclose(waves[1:, 1], [0.3 * np.sin(0.4), 0.3 * np.cos(0.4)])


def test_with_the_stator_in_place_and_its_cogging_torque_known() -> None:
    found = with_stator(1, repeats=2)
    assert found.stator
    assert found.inertia_kg_m2 == pytest.approx(TRUTH_KG_M2, rel=2e-3)
    known = {s.source: s.uncertainty for s in found.budget.shares}["frequency"]
    free = {s.source: s.uncertainty for s in combine(releases(1, 6), nominal_setup()).budget.shares}
    assert known > free["frequency"]
