"""Gray code, angle wrapping and the tracking filter."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.config.timing import POSITION_AGE_MAX_S
from motord.control import observer
from motord.schema import Flag, Request, State, Trip
from tests.unit.control.bench import Bench, make_config


@pytest.mark.kernel
@given(st.integers(0, 2**32 - 1))
def test_gray_code_round_trip(count: int) -> None:
    assert observer.gray_to_count(count ^ (count >> 1)) == count


@pytest.mark.kernel
@given(st.floats(-1e6, 1e6))
def test_wrapping(angle_rad: float) -> None:
    wrapped = observer.wrap_angle(angle_rad)
    assert 0.0 <= wrapped < 2 * math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle_rad), abs=1e-6)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle_rad), abs=1e-6)
    assert -math.pi <= observer.wrap_difference(angle_rad) <= math.pi


@pytest.mark.kernel
def test_direction_and_impossible_codes() -> None:
    forward = Bench(make_config(motor={"counts": 1000})).parameters[0]
    backward = Bench(make_config(motor={"counts": 1000, "encoder_direction": -1})).parameters[0]
    assert observer.decode(5 ^ (5 >> 1), forward) == 5
    assert observer.decode(5 ^ (5 >> 1), backward) == 995
    assert observer.decode(0, backward) == 0
    assert observer.decode(1000 ^ (1000 >> 1), forward) == -1


@pytest.mark.parametrize("speed_rad_s", [-15.0, -0.3, 0.0, 3.0, 6.3, 18.0])
def test_tracks_a_constant_speed(speed_rad_s: float) -> None:
    bench = Bench()
    bench.speed_rad_s = speed_rad_s
    bench.run(1000)
    cell_rad = 2 * math.pi / 4096
    errors_rad, speeds_rad_s = [], []
    for _ in range(500):
        tick = bench.run()
        errors_rad.append(observer.wrap_difference(float(tick.angle_rad) - bench.angle_rad))
        speeds_rad_s.append(float(tick.speed_rad_s))
    assert np.abs(errors_rad).max() < 0.75 * cell_rad
    assert abs(np.mean(errors_rad)) < 0.5 * cell_rad
    assert np.mean(speeds_rad_s) == pytest.approx(speed_rad_s, abs=0.02)


def test_angle_is_better_than_the_encoder_when_turning() -> None:
    """Tracking averages the quantisation: less than its 0.289 of a cell, at the loop's rate."""
    bench = Bench(make_config(loop={"rate_Hz": 2000}))
    bench.speed_rad_s = 5.1
    bench.run(2000)
    errors_rad = []
    for _ in range(4000):
        tick = bench.run()
        errors_rad.append(observer.wrap_difference(float(tick.angle_rad) - bench.angle_rad))
    assert 0.01 < np.std(errors_rad) / (2 * math.pi / 4096) < 0.27


@pytest.mark.kernel
def test_one_glitch_is_ridden_through() -> None:
    bench = Bench()
    bench.run(200)
    before_rad_s = float(bench.tick["speed_rad_s"][0])
    bench.feedback["encoder_gray"] = 0
    bench.feedback["t_ns"] = bench.feedback["t_inverter_ns"] = bench.now_ns + bench.period_ns
    bench.angle_rad += math.pi  # far from what the code says
    bench.run(healthy=False)
    bench.angle_rad -= math.pi
    tick = bench.run()
    assert abs(float(tick.speed_rad_s) - before_rad_s) < 0.3
    assert tick.trip_bits == 0


def test_no_sample_twice() -> None:
    """A tick without a new encoder sample leaves angle and speed alone."""
    bench = Bench()
    bench.run(100)
    angle_rad, speed_rad_s = bench.tick["angle_rad"][0], bench.tick["speed_rad_s"][0]
    tick = bench.run(3, healthy=False)
    assert (tick.angle_rad, tick.speed_rad_s) == (angle_rad, speed_rad_s)


def test_prediction_reaches_to_where_the_current_flows() -> None:
    config = make_config(inverter={"actuation_delay_s": 0.002})
    bench = Bench(config)
    bench.run(1000)
    tick = bench.run(2, healthy=False)  # the sample is two periods old
    ahead_s = 0.002 + 0.5e-3 + 2e-3
    predicted_rad = observer.wrap_difference(tick.angle_predicted_rad - tick.angle_rad)
    assert predicted_rad == pytest.approx(bench.speed_rad_s * ahead_s, rel=0.05)


def test_a_gap_explains_more_than_a_period_does() -> None:
    """After a stall the speed is not known: the new sample is taken, not called implausible."""
    bench = Bench()
    bench.run(500)
    bench.now_ns += 200_000_000  # the computer stalled; the rotor was braked meanwhile
    bench.angle_rad += 0.3
    bench.speed_rad_s = 4.0
    tick = bench.run()
    error_rad = observer.wrap_difference(float(tick.angle_rad) - bench.angle_rad)
    assert abs(error_rad) < 0.01
    assert bench.memory["implausible"][0] == 0
    tick = bench.run(100)
    assert float(tick.speed_rad_s) == pytest.approx(4.0, abs=0.2)


@pytest.mark.kernel
def test_a_position_that_is_too_old_makes_no_torque() -> None:
    """The sensor may be silent for up to a second by the bench file: no torque after 30 ms."""
    bench = Bench(make_config(bridge={"stale_after_s": 1.0}))
    bench.enable(torque_Nm=1.0)
    bench.run(200)

    def blind(ticks: int) -> np.record:
        for _ in range(ticks):
            bench.feedback["t_inverter_ns"] = bench.now_ns + bench.period_ns
            bench.run(healthy=False)
        return bench.tick[0]

    tick = blind(round(POSITION_AGE_MAX_S * 1e3) - 1)
    assert bench.currents_A().any()
    assert not tick["flags"] & Flag.POSITION_AGED
    tick = blind(2)
    assert tick.state == State.ENABLED
    assert tick["flags"] & Flag.POSITION_AGED
    assert not bench.currents_A().any()
    tick = bench.run()  # a sample again
    assert bench.currents_A().any()
    assert not tick["flags"] & Flag.POSITION_AGED


def test_a_bench_without_any_position_cannot_be_enabled() -> None:
    """Codes beyond the encoder's counts from the start: nothing jumps, and nothing is known."""
    bench = Bench(make_config(motor={"counts": 4000}))
    bench.count_at = lambda angle_rad: 4050
    tick = bench.run(50)
    assert tick.trip_bits == Trip.ENCODER_IMPLAUSIBLE
    bench.ask(Request.ENABLE)
    assert bench.run(50).state == State.OFF


@pytest.mark.parametrize("wrong", ["jump", "no position", "before the last one"])
def test_a_wrong_sample_that_stays_the_newest_for_many_ticks_counts_once(wrong: str) -> None:
    """A bridge slower than the loop: three wrong samples trip, not three ticks with one of them."""
    bench = Bench(make_config(bridge={"stale_after_s": 1.0}))
    bench.enable()
    bench.run(50)
    f, good_ns = bench.feedback[0], bench.now_ns
    for number in range(1, 4):
        count = (bench.count_at(bench.angle_rad) + 2048) % 4096
        f["encoder_gray"] = 0xFFFF if wrong == "no position" else count ^ (count >> 1)
        early = wrong == "before the last one"
        f["t_ns"] = good_ns - number * bench.period_ns if early else bench.now_ns + bench.period_ns
        for _ in range(8):
            f["t_inverter_ns"] = bench.now_ns + bench.period_ns
            state = bench.run(healthy=False)["state"]
            assert state == (State.ENABLED if number < 3 else State.TRIPPED)
    assert bench.tick["first_trip"][0] == Trip.ENCODER_IMPLAUSIBLE


@pytest.mark.kernel
@pytest.mark.parametrize("wrong", ["jump", "no position", "before the last one"])
@pytest.mark.parametrize("good", [1, 2])
def test_two_good_samples_in_a_row_are_asked_for_after_any_wrong_one(wrong: str, good: int) -> None:
    bench = Bench()
    bench.enable()
    bench.run(50)
    f = bench.feedback[0]
    for _ in range(3):
        count = (bench.count_at(bench.angle_rad) + 2048) % 4096
        f["encoder_gray"] = 0xFFFF if wrong == "no position" else count ^ (count >> 1)
        early = wrong == "before the last one"
        f["t_ns"] = bench.now_ns - bench.period_ns // 2 if early else bench.now_ns + 1_000_000
        f["t_inverter_ns"] = bench.now_ns + bench.period_ns
        bench.run(healthy=False)
        tripped = bench.tick["state"][0] == State.TRIPPED
        bench.run(good)
    assert tripped == (good == 1)
    assert not tripped or bench.tick["first_trip"][0] == Trip.ENCODER_IMPLAUSIBLE


@pytest.mark.kernel
def test_no_position_before_the_last_sample_is_no_position() -> None:
    bench = Bench()
    bench.run(50)
    f, good_ns = bench.feedback[0], bench.now_ns
    for number in range(1, 4):
        f["encoder_gray"], f["t_ns"] = 0xFFFF, good_ns - number * 1000
        bits = Trip(int(bench.run(healthy=False)["trip_bits"]))
        assert bool(bits & Trip.ENCODER_IMPLAUSIBLE) == (number == 3)


@pytest.mark.parametrize("rate_Hz", [100, 150, 199, 1000])
@pytest.mark.parametrize("speed_rad_s", [-15.0, 0.3, 18.0])
def test_speed_comes_from_samples_of_any_spacing(rate_Hz: int, speed_rad_s: float) -> None:
    bench = Bench(make_config(loop={"rate_Hz": rate_Hz}))
    bench.speed_rad_s = speed_rad_s
    bench.run(rate_Hz)
    speeds_rad_s = [float(bench.run().speed_rad_s) for _ in range(rate_Hz)]
    assert np.mean(speeds_rad_s) == pytest.approx(speed_rad_s, abs=0.02)
    assert max(speeds_rad_s) - min(speeds_rad_s) < 0.2
