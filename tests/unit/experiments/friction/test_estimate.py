"""The estimate on coast-downs of known friction: bias, coverage, Stribeck part, what is refused."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from motord.experiments.analysis import encode
from motord.experiments.friction.coast_down_fit import fitted
from motord.experiments.friction.coast_down_rows import CoastDown
from motord.experiments.friction.report import friction_over_speed
from motord.experiments.friction.result import DirectionalFriction, Friction, Inertia
from motord.identification import IdentifyError
from motord.intervals import coverage_factor, freedom_of
from tests.campaigns.friction import COVERED, ROTORS, coverage, held, recordings
from tests.unit.experiments.friction.coasting import (
    INERTIA,
    MOTOR,
    Rotor,
    coast_downs,
    friction,
    of_draws,
    of_seeds,
)

STRIBECK = Rotor(stribeck_Nm=0.02, cogging=((16, 0.002, 0.0),))


def holds(low: float, value: float, high: float) -> bool:
    return low < value < high


def both_hold(one: DirectionalFriction, rotor: Rotor) -> bool:
    return holds(one.coulomb_Nm.low, rotor.coulomb_Nm, one.coulomb_Nm.high) and holds(
        one.viscous_Nm_s_per_rad.low, rotor.viscous_Nm_s_per_rad, one.viscous_Nm_s_per_rad.high
    )


@cache
def trials(name: str, seeds: int) -> list[DirectionalFriction]:
    """Return what the coast-downs of each seed show of a rotor."""
    several = recordings(ROTORS[name], range(seeds))
    return [one for coasts in several for one in friction(coasts).directions]


@cache
def measured(seed: int, number: int) -> Friction:
    """Return what coast-downs of the rotor show; several tests look at them."""
    return friction(coast_downs(np.random.default_rng(seed), Rotor(), number))


@cache
def slow(rotor: Rotor) -> list[CoastDown]:
    """Return coast-downs to a low speed; several tests look at them."""
    return coast_downs(np.random.default_rng(7), rotor, 6, start_rad_s=8.0, stop_rad_s=0.6)


@pytest.mark.parametrize(
    ("name", "seeds", "most"), [("no cogging torque", 80, COVERED[1]), ("cogging torque", 24, 1.0)]
)
def test_intervals_hold_the_truth_as_often_as_they_say(name: str, seeds: int, most: float) -> None:
    rotor = ROTORS[name]
    found = coverage(held(rotor, one) for one in trials(name, seeds))
    assert found.kept(most), found


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("longest_step", [1, 4])
def test_cogging_and_friction_are_separated(direction: int, longest_step: int) -> None:
    rotor = Rotor()
    rng = np.random.default_rng(5)
    coasts = coast_downs(rng, rotor, 8, direction=direction, longest_step=longest_step)
    (one,) = friction(coasts).directions
    assert one.direction == ("forwards" if direction > 0 else "backwards")
    assert one.coulomb_Nm.value == pytest.approx(rotor.coulomb_Nm, rel=0.02)
    assert one.viscous_Nm_s_per_rad.value == pytest.approx(rotor.viscous_Nm_s_per_rad, rel=0.02)
    lines = {line.order: line.amplitude_Nm for line in one.cogging}
    assert lines[16] == pytest.approx(np.hypot(0.05, 0.02), rel=0.05)
    assert lines[48] == pytest.approx(np.hypot(0.1, 0.2), rel=0.05)
    assert one.stribeck is None
    assert one.residual_rad == pytest.approx(2 * np.pi / 4096 / np.sqrt(12), rel=0.1)


def test_cogging_that_is_not_fitted_would_be_seen_in_the_residual() -> None:
    rotor = Rotor(cogging=((5, 0.1, 0.0),))  # no order of 48 slots and 16 poles
    found = friction(coast_downs(np.random.default_rng(1), rotor, 8))
    assert "residual" in {finding.name for finding in found.findings}


def test_a_stribeck_part_is_found_with_its_speed() -> None:
    rng = np.random.default_rng(2)
    found = friction(coast_downs(rng, STRIBECK, 10, start_rad_s=8.0, stop_rad_s=0.6))
    (one,) = found.directions
    assert one.stribeck is not None
    assert one.stribeck_limit_Nm is None
    assert one.stribeck.torque.value == pytest.approx(0.02, rel=0.01)
    assert one.stribeck.speed.value == pytest.approx(2.0, rel=0.01)
    assert both_hold(one, STRIBECK)
    for point in one.curve:
        w = point.speed_rad_s
        truth_Nm = 0.03 + 0.002 * w + 0.02 * np.exp(-((w / 2.0) ** 2))
        assert point.torque_Nm == pytest.approx(truth_Nm, rel=0.01)
        assert point.low_Nm < point.torque_Nm < point.high_Nm


def test_a_stribeck_part_that_is_too_small_is_not_stated_but_limited() -> None:
    rotor = replace(STRIBECK, stribeck_Nm=2e-5, stribeck_rad_s=6.0)
    rng = np.random.default_rng(3)
    found = friction(coast_downs(rng, rotor, 10, start_rad_s=12.0, stop_rad_s=5.0))
    (one,) = found.directions
    assert one.stribeck is None
    assert one.stribeck_limit_Nm is not None
    at_least_speed_Nm = 2e-5 * np.exp(-((one.speed_min_rad_s / 6.0) ** 2))
    assert at_least_speed_Nm < one.stribeck_limit_Nm < 3e-3
    assert "no Stribeck part seen" in " ".join(found.notes)
    large = replace(one, stribeck_limit_Nm=0.0123)
    assert large.parts["Stribeck (mNm)"] == "not seen: at most 12"


@pytest.mark.parametrize("stop_rad_s", [5.0, 6.5, 9.0])
def test_speeds_near_each_other_are_analysed(stop_rad_s: float) -> None:
    rotor = Rotor(cogging=())
    coasts = coast_downs(np.random.default_rng(12), rotor, 8, stop_rad_s=stop_rad_s)
    (one,) = friction(coasts).directions
    assert one.speed_min_rad_s == pytest.approx(stop_rad_s, rel=0.02)
    assert both_hold(one, rotor)


def test_windage_is_named_and_the_intervals_hold_the_truth() -> None:
    rotor = Rotor(cogging=(), windage_Nm_s2_per_rad2=4e-5)  # a tenth of the torque at 12 rad/s
    (one,) = (found := friction(coast_downs(np.random.default_rng(15), rotor, 10))).directions
    (named,) = (finding for finding in found.findings if finding.name == "windage")
    assert named.severity == "serious"
    top_Nm = 4e-5 * one.speed_max_rad_s**2
    assert one.windage.torque_Nm == pytest.approx(top_Nm, abs=2 * one.windage.half_Nm)
    assert abs(one.coulomb_Nm.value - rotor.coulomb_Nm) > 1e-3
    assert f"{1e3 * one.windage.coulomb_change_Nm:+.3g} mNm" in named.meaning
    assert both_hold(one, rotor)
    for point in one.curve:
        w = point.speed_rad_s
        assert holds(point.low_Nm, 0.03 + 0.002 * w + 4e-5 * w**2, point.high_Nm)


def test_windage_that_is_too_small_for_the_finding_is_in_the_intervals() -> None:
    """Where 0 is not in the interval of the torque; half of Coulomb friction's was 0.02 mNm."""
    rotor = Rotor(windage_Nm_s2_per_rad2=3e-6)  # 0.43 mNm at 12 rad/s
    (one,) = (found := friction(next(of_seeds([6], rotor, 8, longest_step=1)))).directions
    assert "windage" not in {finding.name for finding in found.findings}
    assert one.windage.half_Nm < abs(one.windage.torque_Nm) < one.windage.limit_Nm
    assert abs(one.coulomb_Nm.value - rotor.coulomb_Nm) > 1e-4
    assert both_hold(one, rotor)
    for point in one.curve:
        w = point.speed_rad_s
        assert holds(point.low_Nm, 0.03 + 0.002 * w + 3e-6 * w**2, point.high_Nm)
    assert "(windage) seen for certain" in " ".join(found.notes)


def test_friction_that_differs_between_coast_downs_is_no_windage() -> None:
    rng = np.random.default_rng(16)
    own_Nm = 0.03 * rng.normal(1, 0.01, 6 * 6)  # one of each path
    for coasts in of_draws([rng] * 6, replace(Rotor(cogging=()), coulomb_Nm=own_Nm), 6):
        found = friction(coasts)
        assert "windage" not in {finding.name for finding in found.findings}
        assert "no torque with the square of the speed" in " ".join(found.notes)


@pytest.mark.parametrize("relative_uncertainty", [0.0, 0.02])
@pytest.mark.parametrize("rotor", [Rotor(cogging=()), STRIBECK], ids=["plain", "stribeck"])
def test_each_point_of_the_curve_has_its_standard_uncertainty(
    rotor: Rotor, relative_uncertainty: float
) -> None:
    inertia = replace(INERTIA, relative_uncertainty=relative_uncertainty)
    (one,) = friction(slow(rotor), inertia=inertia).directions
    assert (one.stribeck is not None) == (rotor is STRIBECK)
    k = coverage_factor()
    for point in one.curve:
        of_inertia = relative_uncertainty * point.torque_Nm
        of_fit = np.sqrt(point.stderr_Nm**2 - of_inertia**2)
        half = (point.high_Nm - point.low_Nm) / 2
        # Satterthwaite's degrees of freedom: the five that six coast-downs have are the most
        low, high = (np.hypot(coverage_factor(n) * of_fit, k * of_inertia) for n in (5, 3))
        assert low * (1 - 1e-6) < half < high
    assert encode(one.curve[0])["stderr_Nm"] == one.curve[0].stderr_Nm


def test_the_curve_has_the_degrees_of_freedom_of_its_fit() -> None:
    coasts = slow(Rotor(cogging=()))
    (one,) = friction(coasts).directions
    group, _ = fitted(tuple(coasts), MOTOR)
    of_fit = [group.fit.freedom(np.array([1.0, point.speed_rad_s])) for point in one.curve]
    stated = [freedom_of((p.high_Nm - p.low_Nm) / 2, p.stderr_Nm) for p in one.curve]
    assert stated == pytest.approx(of_fit, rel=1e-6)
    assert min(of_fit) < 4.8


def test_the_curve_holds_the_truth_as_often_as_it_says() -> None:
    """80 trials of 8 coast-downs, 25 points each."""
    shares = [
        holds(point.low_Nm, 0.03 + 0.002 * point.speed_rad_s, point.high_Nm)
        for one in trials("no cogging torque", 80)
        for point in one.curve
    ]
    assert len(shares) == 80 * 25
    assert np.mean(shares) >= 0.95 - 0.049  # two standard errors of the trials


def test_lines_that_are_the_same_either_way_are_both_seen() -> None:
    forwards = measured(4, 4).directions[0]
    backwards = replace(forwards, direction="backwards")
    right = friction_over_speed([forwards, backwards]).axes[1]
    for below, above in (right.lines[::2], right.lines[1::2]):
        np.testing.assert_array_equal(below.get_xydata(), above.get_xydata())
        assert below.get_linewidth() > 2 * above.get_linewidth()
        assert below.get_color() != above.get_color()


def test_each_direction_has_its_own_friction_and_its_side_of_the_curve() -> None:
    rng = np.random.default_rng(4)
    other = replace(Rotor(), coulomb_Nm=0.04)
    coasts = coast_downs(rng, Rotor(), 8) + coast_downs(rng, other, 8, direction=-1)
    found = friction(coasts)
    assert [one.direction for one in found.directions] == ["forwards", "backwards"]
    assert both_hold(found.directions[0], Rotor())
    assert both_hold(found.directions[1], other)
    assert "directions-differ" in {finding.name for finding in found.findings}
    curve = found.curve
    assert [p.speed_rad_s for p in curve] == sorted(p.speed_rad_s for p in curve)
    for point in curve:
        assert point.speed_rad_s * point.torque_Nm > 0
        assert point.low_Nm < point.torque_Nm < point.high_Nm
    lowest = min(one.speed_min_rad_s for one in found.directions)
    assert min(abs(point.speed_rad_s) for point in curve) == pytest.approx(lowest)


def test_the_inertia_scales_torques_and_widens_their_intervals() -> None:
    coasts = coast_downs(np.random.default_rng(9), Rotor(), 6)
    exact = measured(9, 6).directions[0]
    found = friction(coasts, Inertia(2 * INERTIA.kg_m2, 0.02, "test", freedom=3.0))
    assert "(test, +-6.4 %)" in found.notes[-1]
    doubled = found.directions[0]
    coulomb = doubled.coulomb_Nm
    assert coulomb.value == pytest.approx(2 * exact.coulomb_Nm.value)
    half = coulomb.high - coulomb.value
    expected = np.hypot(2 * exact.coulomb_fit_Nm, coverage_factor(3.0) * 0.02 * coulomb.value)
    assert half == pytest.approx(expected)
    stderr = np.hypot(2 * exact.coulomb_Nm.stderr, 0.02 * coulomb.value)
    assert coulomb.stderr == pytest.approx(stderr)


def test_standard_errors_have_one_degree_of_freedom_less_than_there_are_coast_downs() -> None:
    one = measured(4, 4).directions[0]
    for part in (one.coulomb_Nm, one.viscous_Nm_s_per_rad):
        assert freedom_of(part.high - part.value, part.stderr) == pytest.approx(3)


def test_few_coast_downs_of_one_direction_are_findings() -> None:
    found = friction(coast_downs(np.random.default_rng(7), Rotor(), 3))
    names = {finding.name for finding in found.findings}
    assert {"few-coast-downs", "one-direction"} <= names
    for finding in encode(found)["findings"]:
        assert set(finding) == {
            "name", "value", "limit", "unit", "severity", "meaning", "action",
        }  # fmt: skip


def test_cogging_at_the_stop_speed_is_a_finding() -> None:
    rotor = Rotor(cogging=((16, 0.25, 0.0),))
    coasts = coast_downs(np.random.default_rng(8), rotor, 6, stop_rad_s=2.2)
    names = {finding.name for finding in friction(coasts).findings}
    assert "cogging-at-stop-speed" in names


def test_the_json_has_units_and_no_samples() -> None:
    content = encode(measured(9, 6))
    assert list(content) == [
        "inertia_kg_m2", "inertia_relative_uncertainty", "inertia_source", "coast_downs",
        "directions", "curve", "residual_rad", "findings", "notes",
    ]  # fmt: skip
    assert "fits" not in content["directions"][0]
    assert set(content["curve"][0]) == {
        "speed_rad_s", "torque_Nm", "low_Nm", "high_Nm", "stderr_Nm",
    }  # fmt: skip


def test_a_small_motor_has_the_digits_of_its_intervals() -> None:
    coasts = coast_downs(np.random.default_rng(9), Rotor(), 6)
    exact = measured(9, 6).directions[0]
    small = friction(coasts, replace(INERTIA, kg_m2=1e-4 * INERTIA.kg_m2)).directions[0]
    for name in ("Coulomb (mNm)", "viscous (mNm s/rad)"):
        value, half = (float(part) for part in small.parts[name].split(" +- "))
        larger, wider = (1e-4 * float(part) for part in exact.parts[name].split(" +- "))
        assert value == pytest.approx(larger, abs=0.1 * wider)
        assert half == pytest.approx(wider, rel=0.1)


def test_what_cannot_be_fitted_is_refused_in_one_line() -> None:
    coasts = coast_downs(np.random.default_rng(10), Rotor(), 2)
    with pytest.raises(IdentifyError, match="2 good coast-downs forwards: 3 are needed at least"):
        friction(coasts)
    with pytest.raises(IdentifyError, match="no good coast-down"):
        friction([])
    t_ns = np.arange(1000) * 1_000_000
    still = np.zeros(1000)
    with pytest.raises(IdentifyError, match=r"run: coast-down 4: the rotor coasted for 0 turns"):
        CoastDown.of("run", 3, t_ns, still, 4096)
    with pytest.raises(IdentifyError, match="10 samples only"):
        CoastDown.of("run", 0, t_ns[:10], still[:10], 4096)


def test_what_comes_after_a_turning_back_is_left_out() -> None:
    t_ns = np.arange(3000) * 1_000_000
    t_s = t_ns * 1e-9
    angle_rad = 10 * t_s - 2.5 * t_s**2  # turns back at 2 s
    one = CoastDown.of("run", 0, t_ns, angle_rad, 4096)
    assert one.t_s[-1] == pytest.approx(2.0, abs=0.05)
