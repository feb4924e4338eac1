"""Which points of the mesh are taken: the envelope, quadrant by quadrant; what is refused."""

from math import pi

import pytest

from motord.config import Config, load, packaged
from motord.experiments.plans import build
from motord.experiments.torque_speed import TorqueSpeedConfig
from motord.experiments.torque_speed.plan import Envelope
from motord.sequencing import PlanError
from motord.virtual import VirtualBench, run_plan

BENCH = packaged("../../../config/efficiency.toml")


@pytest.fixture(scope="module")
def config() -> Config:
    return load(BENCH)


def envelope(config: Config, **settings: object) -> Envelope:
    return Envelope(config, TorqueSpeedConfig(**settings))


@pytest.mark.parametrize(
    ("torque_Nm", "speed_Hz", "settings", "why"),
    [
        (5.0, 4.0, {}, ""),
        (-5.0, -4.0, {}, ""),
        (6.1, 4.0, {}, "above [limits] torque_Nm"),
        (1.0, 11.0, {}, " Hz, 80 % of [limits] trip_speed_rad_s"),
        (5.0, 1.0, {}, "the brake holds at most 3.66 Nm at 1 Hz"),
        (-1.0, 4.0, {}, "more than the external drive carries"),
        (-1.0, 4.0, {"drive_torque_Nm": 1.0}, ""),
        (1.0, -4.0, {"drive_torque_Nm": 1.0}, ""),
        (-1.0, 9.9, {"drive_torque_Nm": 1.0}, "faster than the drive can turn"),
        (4.0, 4.0, {"power_max_W": 100.0}, "101 W is above power_max_W = 100"),
        (3.9, 4.0, {"power_max_W": 100.0}, ""),
        (1.0, 8.0, {"bus_V": 10.0}, "V needed, bus_V = 10"),
        (1.0, 8.0, {"bus_V": 11.5}, ""),
        (5.0, 8.0, {"bus_V": 11.5, "resistance_ohm": 0.1}, "V needed, bus_V = 11.5"),
    ],
)
def test_what_the_bench_cannot_hold(
    config: Config, torque_Nm: float, speed_Hz: float, settings: dict[str, float], why: str
) -> None:
    said = envelope(config, **settings).obstacle(torque_Nm, speed_Hz)
    assert why in said
    assert bool(why) == bool(said)


def test_the_current_that_may_flow_for_long_limits_the_torque(config: Config) -> None:
    limits = config.limits.model_copy(update={"i2t_current_A": 10.0})
    hot = envelope(config.model_copy(update={"limits": limits}))
    largest_Nm = hot.largest_Nm(1.0, 4.0)
    rated_A = config.motor.rated_current_A()
    assert largest_Nm == pytest.approx(6.0 * 10.0 / rated_A, rel=1e-3)
    assert "more than may flow for long" in hot.obstacle(largest_Nm + 0.01, 4.0)


def test_the_envelope_is_where_points_begin_to_be_refused(config: Config) -> None:
    found = envelope(config, bus_V=11.6, resistance_ohm=0.1, drive_torque_Nm=3.0)
    assert found.largest_Nm(1.0, 1.0) == pytest.approx(3.66, abs=0.01)  # of the brake
    assert found.largest_Nm(1.0, 3.0) == 6.0
    fast_Nm = found.largest_Nm(1.0, 8.0)  # of the supply
    assert 2.0 < fast_Nm < 5.0
    assert found.obstacle(fast_Nm, 8.0) == ""
    assert "V needed" in found.obstacle(1.001 * fast_Nm, 8.0)
    assert found.largest_Nm(-1.0, 3.0) == pytest.approx(-3.0)
    assert found.largest_Nm(1.0, 20.0) == pytest.approx(0.0, abs=1e-5)


def test_points_beyond_are_left_out_and_motoring_comes_first(config: Config) -> None:
    plan = build("torque-speed", config, {"torques_Nm": [-4.0, 5.0], "speeds_Hz": [1.0, 4.0]})
    places = [(point.torque_Nm, point.speed_Hz) for point in plan.points]
    assert places == [(5.0, 4.0), (-4.0, 1.0), (-4.0, 4.0)]
    assert "points beyond the envelope are left out (1), such as 5 Nm at 1 Hz" in plan.outlook
    assert plan.needs == "brake"
    generating = build("torque-speed", config, {"torques_Nm": [-4.0], "speeds_Hz": [1.0]})
    assert (generating.needs, generating.outlook) == ("drive", "")
    assert build("torque-speed", config, plan.settings).points == plan.points


def test_a_sensor_without_the_mean_is_in_the_outlook() -> None:
    assert "does not show the mean torque" in build("torque-speed", load()).outlook


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"torques_Nm": [7.0]}, "every point is beyond the envelope: 7 Nm is above"),
        ({"torques_Nm": [0.0, 1.0]}, "must not be 0"),
        ({"torques_Nm": []}, "torques_Nm"),
        ({"speeds_Hz": [float("nan")]}, "speeds_Hz"),
        ({"readings": "averages"}, "readings"),
        ({"drive_speed_tolerance": 0.6}, "drive_speed_tolerance"),
    ],
)
def test_settings_that_cannot_be_are_refused(
    config: Config, settings: dict[str, object], message: str
) -> None:
    with pytest.raises(PlanError, match=message):
        build("torque-speed", config, settings)


def test_one_plan_takes_both_quadrants_on_one_bench(config: Config) -> None:
    """The drive lets go before the motor works against the brake, and the other way round."""
    settings = {"torques_Nm": [-1.0, 1.0], "speeds_Hz": [3.0], "turns": 3, "settle_s": 2.0}
    plan = build("torque-speed", config, settings)
    plan = plan.part((*plan.points, plan.points[0].__class__(2, 1.0, 3.0, 3)))
    ticks = []
    points = run_plan(VirtualBench(config), plan, lambda block, _: ticks.append(block))
    assert [point["quality"] for point in points] == ["ok"] * 3
    assert [point.get("driven", False) for point in points] == [False, True, False]
    assert [point["envelope_Nm"] for point in points] == [6.0, -5.0, 6.0]
    for point in points:
        assert point["speed_mean_Hz"] == pytest.approx(3.0, rel=0.1)
    for block in ticks:
        if (block["plan_point"] == 1).any():
            taken = block[block["plan_point"] == 1]
            assert (taken["brake_set"] == 0).all()
            assert taken["drive_set_rad_s"] == pytest.approx(6 * pi, rel=1e-6)
        both = (block["brake_set"] > 0) & (block["drive_set_rad_s"] != 0)
        assert not both.any()
