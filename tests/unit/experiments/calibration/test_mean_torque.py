"""Mean torque against that of the currents: an angle that is far off, which ripple alone hides."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from motord.config import AccuracyConfig, TorqueSensorConfig
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.checks import NoFitError
from motord.experiments.calibration.estimate.lack_of_fit.mean_torque import MeanTorques
from motord.findings import Finding
from motord.identification import IdentifyError
from motord.identification.operating_points import PointData, prepare
from motord.identification.torque.torque_of_currents import slope_of
from tests.unit.identification.synthetic_bench import Bench, Truth, motor

NAME = "torque-of-currents"
TRUTH = Truth(alpha=(0.99, 1.01, 1.0), beta_A=(0.1, -0.05, -0.05), cogging={48: (0.03, 0.2)})
PASSES_MEAN = TorqueSensorConfig()
HIGHPASS = TorqueSensorConfig(highpass_time_constant_s=2.0)
SIX = ((1.0, 3.0, 5.0), (0.6, 1.0))
TWO = ((2.0, 4.0), (1.0,))


@cache
def recorded(
    connection: str, mesh: tuple[tuple[float, ...], ...], delta: float, sensor: TorqueSensorConfig
) -> tuple[PointData, ...]:
    truth = replace(TRUTH, delta=delta)
    bench = Bench(motor(connection=connection), truth, sensor, drift_Nm=0.0)
    return tuple(bench.mesh(*mesh))


def turned(point: PointData, electrical_deg: float) -> PointData:
    ticks = point.ticks.copy()
    ticks["encoder_count"] += round(4096 * electrical_deg / 360 / 8)
    ticks["encoder_count"] %= 4096
    return replace(point, ticks=ticks)


def found(
    electrical_deg: float,
    connection: str = "star",
    mesh: tuple[tuple[float, ...], ...] = SIX,
    delta: float = 1.0,
    sensor: TorqueSensorConfig = PASSES_MEAN,
    accuracy: AccuracyConfig | None = None,
) -> tuple[Finding, ...]:
    """Return the findings by that name."""
    found = all_found(electrical_deg, connection, mesh, delta, sensor, accuracy)
    return tuple(one for one in found if one.name == NAME)


@cache
def all_found(
    electrical_deg: float,
    connection: str,
    mesh: tuple[tuple[float, ...], ...],
    delta: float,
    sensor: TorqueSensorConfig,
    accuracy: AccuracyConfig | None,
) -> tuple[Finding, ...]:
    calibrator = Calibrator(motor(connection=connection), sensor, accuracy=accuracy)
    for point in recorded(connection, mesh, delta, sensor):
        calibrator.add(turned(point, electrical_deg))
    return calibrator.result("joint").findings


@pytest.mark.parametrize("mesh", [SIX, TWO], ids=["six points", "two points"])
@pytest.mark.parametrize("electrical_deg", [0.0, 3.0, -20.0, 20.0, 90.0, 180.0])
def test_an_angle_that_is_far_off_is_a_finding(
    electrical_deg: float, mesh: tuple[tuple[float, ...], ...]
) -> None:
    """It is serious from 20 deg on where the ripple of enough points is serious, too."""
    severities = []
    if abs(electrical_deg) > 3.0:
        severities = ["warning" if mesh is TWO and abs(electrical_deg) < 90.0 else "serious"]
    assert [one.severity for one in found(electrical_deg, mesh=mesh)] == severities


def test_it_comes_first_and_names_what_the_same_angle_makes_of_the_ripple() -> None:
    """Its cause looks like several departures at once, which are not there."""
    first, *others = all_found(20.0, "star", SIX, 1.0, PASSES_MEAN, None)
    serious = [one.name for one in others if one.severity == "serious"]
    assert first.name == NAME
    assert serious
    assert f"{', '.join(serious)} may be of the same cause" in first.meaning.replace(";", ",")


@pytest.mark.parametrize("electrical_deg", [20.0, 90.0])
def test_a_sensor_that_does_not_pass_the_mean_shows_none(electrical_deg: float) -> None:
    assert found(electrical_deg, sensor=HIGHPASS) == ()


def test_it_says_which_angle_would_do_that() -> None:
    [finding] = found(90.0, mesh=SIX)
    assert finding.value == pytest.approx(100, abs=5)
    assert "torque that currents, position and back-EMF make changes" in finding.meaning
    [finding] = found(180.0, mesh=SIX)
    assert finding.value == pytest.approx(200, abs=5)


def test_a_refusal_says_so_too() -> None:
    """With independent phases nothing is left of the torque that gains could explain."""
    with pytest.raises(IdentifyError, match="mean torque that currents, position and back-EMF"):
        found(90.0, "independent")
    with pytest.raises(IdentifyError) as refused:
        found(90.0, "independent", sensor=HIGHPASS)
    assert "mean torque" not in str(refused.value)
    assert refused.value.__cause__ is not refused.value


@pytest.mark.parametrize("connection", ["independent", "star"])
def test_a_refusal_of_a_fit_has_the_likelier_cause_first_and_no_other_advice(
    connection: str,
) -> None:
    """Larger torques and more turns do not help against an angle that is off."""
    known = NoFitError("alpha of phase b is known to +-0.2 only", ": take more turns")
    means = MeanTorques(motor(connection=connection), PASSES_MEAN)
    for point in recorded(connection, SIX, 1.0, PASSES_MEAN):
        means.add(prepare(turned(point, 20.0), 4096))
    refused = str(means.explained(known, AccuracyConfig()))
    assert refused.startswith("the mean torque that currents, position and back-EMF make changes")
    assert refused.endswith(f"({known.fact})")
    assert "more turns" not in refused
    few = IdentifyError("5 whole turns in all")
    assert means.explained(few, AccuracyConfig()) is None


def test_a_refusal_that_names_a_phase_says_that_first() -> None:
    """The currents of the others make two thirds of the torque: no angle does that."""
    calibrator = Calibrator(motor(), PASSES_MEAN)
    for point in recorded("independent", SIX, 1.0, PASSES_MEAN):
        ticks = point.ticks.copy()
        ticks["i_b_A"] *= 0.01
        calibrator.add(replace(point, ticks=ticks))
    with pytest.raises(IdentifyError, match=r"^phase b is dead.*; the mean torque"):
        calibrator.result("joint")


@pytest.mark.parametrize(
    ("delta", "stated", "seen"),
    [
        (1.02, AccuracyConfig(), False),
        (1.10, AccuracyConfig(), True),
        (1.10, AccuracyConfig(torque_gain_percent=10.0), False),
    ],
)
def test_a_gain_that_is_stated_is_none(delta: float, stated: AccuracyConfig, seen: bool) -> None:
    assert bool(found(0.0, "independent", delta=delta, accuracy=stated)) is seen


@pytest.mark.parametrize("quantity", ["i", "torque"])
def test_a_unit_that_is_wrong_by_a_thousand_is_one(quantity: str) -> None:
    """The torque in that unit would allow for any saturation."""
    calibrator = Calibrator(motor(connection="star"), PASSES_MEAN)
    for point in recorded("star", SIX, 1.0, PASSES_MEAN):
        ticks = point.ticks.copy()
        for name in ticks.dtype.names or ():
            if name.startswith(quantity) and name.endswith(("_A", "_Nm")):
                ticks[name] *= 1000
        calibrator.add(replace(point, ticks=ticks))
    findings = {one.name: one.severity for one in calibrator.result("joint").findings}
    assert findings[NAME] == "serious"


@pytest.mark.parametrize(("sign", "severity"), [(1, "warning"), (-1, "serious")])
def test_much_friction_that_looks_like_torque_is_a_warning_at_most(
    sign: int, severity: str
) -> None:
    """Of the faster point, which has more torque, it takes twice as much; it turns no sign."""
    calibrator = Calibrator(motor(connection="star"), PASSES_MEAN)
    slow, *_, fast = recorded("star", ((2.0, 4.0), (0.5, 1.0)), 1.0, PASSES_MEAN)
    for point in (slow, fast):
        ticks = point.ticks.copy()
        ticks["torque_Nm"] = sign * (ticks["torque_Nm"] - 2 * point.speed_Hz)
        calibrator.add(replace(point, ticks=ticks))
    [finding] = [one for one in calibrator.result("joint").findings if one.name == NAME]
    assert finding.severity == severity


def test_saturation_that_is_stated_is_none() -> None:
    """At 9 and 12 of 6 Nm the slope loses 35 %, the torque up to 20."""
    stated = AccuracyConfig(saturation_percent=10.0)
    calibrator = Calibrator(motor(connection="star"), PASSES_MEAN, accuracy=stated)
    for point in recorded("star", ((9.0, 12.0), (1.0,)), 1.0, PASSES_MEAN):
        ticks = point.ticks.copy()
        ticks["torque_Nm"] -= 0.1 * ticks["torque_Nm"].mean() ** 2 / motor().rated_torque_Nm
        calibrator.add(replace(point, ticks=ticks))
    assert NAME not in {one.name for one in calibrator.result("joint").findings}


def test_friction_and_zero_of_the_sensor_do_not_count() -> None:
    """Here the torque is larger at higher speeds and forwards, as friction is."""
    velocity_Hz = np.array([0.5, 0.7, 1.0, -0.5, -0.7, -1.0, 0.5])
    made_Nm = np.array([2.0, 3.0, 5.0, 0.5, 3.0, 0.5, 3.0])
    friction_Nm = 0.3 * np.sign(velocity_Hz) + 0.2 * velocity_Hz
    slope = slope_of(made_Nm + 0.7 + friction_Nm, made_Nm, velocity_Hz)
    assert slope.ratio == pytest.approx(1.0, abs=1e-9)
    assert slope.freedom == 3
    assert not slope.with_friction


def test_friction_that_looks_like_torque_leaves_the_slope_in_doubt() -> None:
    """Both grow from the first point to the second."""
    made_Nm, velocity_Hz = np.array([2.0, 4.0]), np.array([0.5, 1.0])
    assert slope_of(made_Nm + 0.2 * velocity_Hz, made_Nm, velocity_Hz).with_friction
    assert not slope_of(made_Nm, made_Nm, np.array([0.70, 0.701])).with_friction


@pytest.mark.parametrize(
    ("gain", "ratio", "measured_smaller"),
    [(0.8, 0.8, True), (1.25, 0.8, False), (-0.5, -0.5, True)],
)
def test_the_smaller_change_is_over_the_larger(
    gain: float, ratio: float, measured_smaller: bool
) -> None:
    made_Nm = np.array([1.0, 3.0])
    slope = slope_of(gain * made_Nm, made_Nm, np.ones(2))
    assert (slope.freedom, slope.measured_smaller) == (0, measured_smaller)
    assert slope.ratio == pytest.approx(ratio)
