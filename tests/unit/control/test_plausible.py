"""Interlocks of what should be, against what is measured: currents, torque, tracks, brake."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.config.rules.torque import dead_sensor_error_Nm, found_late_s
from motord.control.parameters import watched_tracks
from motord.schema import Compensate, Flag, Request, State, Trip
from tests.support.properties import examples
from tests.unit.control.bench import Bench, make_config


class Answering(Bench):
    """A bench whose currents follow a tick later, and whose sensor shows the torque asked for."""

    def __init__(self, **sections: object) -> None:
        limits = {"current_error_A": 5.0, "torque_error_Nm": 1.5} | dict(sections.pop("limits", {}))
        super().__init__(make_config(limits=limits, **sections))
        self.error_A = np.zeros(3)
        self.error_Nm = 0.0
        self.shown_Nm = 0.0
        self.before_Nm = 0.0
        self.stuck = (0, 0)  # mask of tracks, their level

    def ticks(self, count: int) -> np.record:
        tau_s = self.config.torque_sensor.highpass_time_constant_s
        decay = math.exp(-1 / self.config.loop.rate_Hz / tau_s) if tau_s else 1.0
        tick = self.tick[0]
        for _ in range(count):
            set_Nm = float(self.memory["torque_set_Nm"][0])
            self.shown_Nm = decay * (self.shown_Nm + set_Nm - self.before_Nm)
            self.before_Nm = set_Nm
            self.feedback["torque_Nm"] = self.shown_Nm + self.error_Nm
            self.feedback["i_A"] = self.command["i_A"] + self.error_A
            tick = self.run()
        return tick

    def run(self, ticks: int = 1, healthy: bool = True, supervised: bool = True) -> np.record:
        if self.stuck[0]:
            self.now_ns += self.period_ns
            self.angle_rad += self.speed_rad_s * self.period_ns * 1e-9
            count = self.count_at(self.angle_rad)
            gray = count ^ (count >> 1)
            f = self.feedback[0]
            f.encoder_gray = (gray & ~self.stuck[0]) | self.stuck[1]
            f.t_ns = f.t_inverter_ns = self.now_ns
            self.now_ns -= self.period_ns
            self.angle_rad -= self.speed_rad_s * self.period_ns * 1e-9
            return super().run(ticks, False, supervised)
        return super().run(ticks, healthy, supervised)


def until_trip(bench: "Answering | Limited", most: int = 2000) -> tuple[int, Trip]:
    for number in range(1, most + 1):
        tick = bench.ticks(1)
        if tick.state == State.TRIPPED:
            return number, Trip(int(tick.first_trip))
    return 0, Trip(0)


def at_torque(torque_Nm: float = 3.0, **sections: object) -> Answering:
    bench = Answering(**sections)
    bench.enable(torque_Nm=torque_Nm)
    bench.ticks(800)
    assert bench.tick["state"][0] == State.ENABLED
    return bench


@pytest.mark.kernel
@pytest.mark.parametrize("connection", ["independent", "star"])
@pytest.mark.parametrize(("error_A", "trips"), [(4.9, False), (5.1, True)])
def test_current_against_its_command(connection: str, error_A: float, trips: bool) -> None:
    bench = at_torque(motor={"connection": connection})
    bench.error_A[1] = error_A * (1.5 if connection == "star" else 1.0)  # less its mean
    number, first = until_trip(bench, 60)
    if trips:
        assert first is Trip.CURRENT_IMPLAUSIBLE
        assert 20 <= number <= 23
        assert not bench.currents_A().any()
    else:
        assert number == 0


@pytest.mark.kernel
def test_after_a_reset_the_time_of_wrong_currents_begins_anew() -> None:
    """Else a moment of them, as there may be, would trip by what was mended."""
    bench = at_torque(limits={"current_error_s": 0.5})
    bench.error_A[0] = 6.0
    assert until_trip(bench)[1] is Trip.CURRENT_IMPLAUSIBLE
    bench.error_A[0] = 0.0
    bench.ticks(5)
    bench.ask(Request.RESET)
    assert bench.ticks(20).state == State.READY
    bench.enable()
    bench.error_A[0] = 6.0
    number, first = until_trip(bench)
    assert first is Trip.CURRENT_IMPLAUSIBLE
    assert 500 <= number <= 503


@pytest.mark.kernel
def test_a_reset_while_currents_are_wrong_gives_them_no_more_time() -> None:
    bench = at_torque(limits={"current_error_s": 0.5})
    bench.feedback["u_bus_V"] = 0.0
    assert until_trip(bench)[1] is Trip.BUS_VOLTAGE
    bench.feedback["u_bus_V"], bench.error_A[0] = 24.0, 6.0
    bench.ticks(450)
    bench.ask(Request.RESET)
    assert bench.ticks(1).state == State.READY
    number, first = until_trip(bench)
    assert first is Trip.CURRENT_IMPLAUSIBLE
    assert 49 <= number <= 52


def test_current_may_be_wrong_for_a_moment_and_samples_count_not_ticks() -> None:
    bench = at_torque()
    for _ in range(5):
        bench.error_A[0] = 20.0
        bench.ticks(19)
        bench.error_A[0] = 0.0
        bench.ticks(19)
    assert bench.tick["state"][0] == State.ENABLED
    bench.error_A[0] = 20.0
    bench.ticks(3)
    bench.run(15, healthy=False)  # stale, not yet for stale_after_s: no further evidence
    assert bench.tick["state"][0] == State.ENABLED


@pytest.mark.kernel
@pytest.mark.parametrize(("error_Nm", "trips"), [(2.05, False), (2.15, True), (-2.15, True)])
def test_torque_against_its_set_point(error_Nm: float, trips: bool) -> None:
    bench = at_torque(3.0)  # a fifth of it is free besides 1.5 Nm
    bench.error_Nm = error_Nm
    number, first = until_trip(bench, 150)
    assert bool(number) == trips
    if trips:
        assert first is Trip.TORQUE_IMPLAUSIBLE
        assert 100 <= number <= 103


class Limited(Bench):
    """A bench at 6 Nm whose limit cuts the peaks of the currents; its sensor is a low-pass.

    It shows the torque that the commanded currents make, or none once it is `dead`.
    """

    def __init__(self, current_A: float, lag_s: float) -> None:
        limits = {"current_A": current_A, "torque_error_Nm": 1.5}
        super().__init__(make_config(limits=limits))
        self.dead = False
        self._keeps = math.exp(-self.period_ns * 1e-9 / lag_s) if lag_s else 0.0
        self._shown_Nm = 0.0
        self.enable(torque_Nm=6.0)
        self.ticks(1000)

    def ticks(self, count: int) -> np.record:
        tick = self.tick[0]
        for _ in range(count):
            place = self.count_at(float(self.command["angle_rad"][0]))
            made_Nm = 0.0 if self.dead else float(self.back_emf[place] @ self.currents_A())
            self._shown_Nm = made_Nm + self._keeps * (self._shown_Nm - made_Nm)
            self.feedback["torque_Nm"] = self._shown_Nm
            tick = self.run()
        return tick


@pytest.mark.kernel
@pytest.mark.parametrize("current_A", [18.2, 17.5])
def test_a_dead_torque_sensor_is_found_where_the_limit_cuts_the_peaks_of_the_currents(
    current_A: float,
) -> None:
    bench = Limited(current_A, 0.0)
    flags = [bench.ticks(1)["flags"] for _ in range(500)]
    share = np.mean([flag & Flag.CURRENT_LIMITED > 0 for flag in flags])
    assert 0.0 < share < 1.0
    bench.dead = True
    number, first = until_trip(bench, 150)
    assert (first, 100 <= number <= 103) == (Trip.TORQUE_IMPLAUSIBLE, True)


@pytest.mark.parametrize("current_A", [17.9, 12.0, 5.0])
@pytest.mark.parametrize("lag_s", [0.0, 0.02, 0.05])
def test_torque_that_the_limit_takes_away_trips_nothing(current_A: float, lag_s: float) -> None:
    bench = Limited(current_A, lag_s)
    assert bench.ticks(2000).state == State.ENABLED


def test_torque_that_is_within_the_limit_again_trips_nothing() -> None:
    bench = Limited(5.0, 0.02)
    bench.setpoint["torque_Nm"] = 1.0
    assert bench.ticks(2000).state == State.ENABLED
    bench.dead = True
    bench.ticks(2000)
    assert bench.memory["torque_cut_Nm"][0] < 1.0  # it is forgotten


@pytest.mark.parametrize("missed", [0, 1, 40, 300])
def test_ticks_that_the_loop_missed_are_time_for_the_sensor_too(missed: int) -> None:
    """An amplifier with a short high-pass forgets the torque while the loop is late."""
    bench = at_torque(
        5.0, torque_sensor={"highpass_time_constant_s": 3.0}, loop={"overrun_ticks": 500},
        inverter={"stale_after_s": 1.0, "timeout_s": 1.0}, bridge={"stale_after_s": 1.0},
    )  # fmt: skip
    for _ in range(6):
        bench.shown_Nm *= math.exp(-missed * bench.period_ns * 1e-9 / 3.0)
        bench.now_ns += missed * bench.period_ns
        bench.angle_rad += bench.speed_rad_s * missed * bench.period_ns * 1e-9
        bench.tick["missed"] += missed
        expected_Nm = bench.shown_Nm
        bench.ticks(2)
        assert bench.memory["torque_expected_Nm"][0] == pytest.approx(expected_Nm, rel=0.01)
    assert bench.tick["state"][0] == State.ENABLED


@pytest.mark.parametrize(
    ("missed", "speed_rad_s", "left", "error_Nm", "trips"),
    [(300, 0.0, -1.0, 0.0, False), (20, 18.0, -1.0, 0.0, False), (10, 0.0, 1.0, 2.55, True)],
)
def test_currents_that_stand_still_while_the_loop_stalls_make_another_torque(
    missed: int, speed_rad_s: float, left: float, error_Nm: float, trips: bool
) -> None:
    """A sensor with a high-pass takes that for the mean, and shows it afterwards."""
    tau_s = 0.3 if missed > 100 else 0.03
    bench = at_torque(
        5.0, torque_sensor={"highpass_time_constant_s": tau_s}, loop={"overrun_ticks": 500},
        inverter={"stale_after_s": 1.0, "timeout_s": 1.0}, bridge={"stale_after_s": 1.0},
        limits={"torque_error_s": 0.01},
    )  # fmt: skip
    lacks_Nm = (1.0 - left) * 5.0
    bench.speed_rad_s, stood_s = speed_rad_s, missed * bench.period_ns * 1e-9
    bench.ticks(100)
    bench.shown_Nm = math.exp(-stood_s / tau_s) * (bench.shown_Nm - lacks_Nm) + lacks_Nm
    bench.now_ns += missed * bench.period_ns
    bench.angle_rad += speed_rad_s * stood_s
    bench.tick["missed"] += missed
    bench.error_Nm = error_Nm
    assert bool(until_trip(bench, 150)[0]) == trips


def test_torque_means_nothing_while_none_is_applied() -> None:
    bench = Answering()
    bench.error_Nm = 8.0
    bench.run(5)
    assert until_trip(bench, 300)[0] == 0
    assert bench.tick["trip_bits"][0] == 0


def test_torque_that_is_limited_on_purpose_is_no_fault() -> None:
    limits = {"current_A": 3.0, "trip_current_A": 40.0, "current_error_A": 2.5}
    bench = at_torque(4.0, limits=limits)
    bench.error_Nm = -3.0
    assert until_trip(bench, 300)[0] == 0


OFFSETS_A = np.array([10.0, -5.0, -5.0])


def most_Nm(bench: Bench) -> float:
    """Return what `OFFSETS_A` make at most: each phase where its back-EMF is largest."""
    table = bench.config.motor.back_emf_table()
    return float(np.abs(table).max() * np.abs(OFFSETS_A).sum())


@pytest.mark.kernel
@pytest.mark.parametrize("beyond", [-0.05, 0.05])
def test_what_offsets_that_are_induced_make_at_most_is_no_fault(beyond: float) -> None:
    bench = at_torque(0.0)
    bench.setpoint["induced_offset_A"] = OFFSETS_A
    bench.error_Nm = -(most_Nm(bench) + 1.5 + beyond)
    assert bool(until_trip(bench, 150)[0]) == (beyond > 0)


def test_an_offset_that_ended_allows_nothing_any_more() -> None:
    bench = at_torque(0.0)
    bench.setpoint["induced_offset_A"] = OFFSETS_A
    bench.ticks(50)
    bench.setpoint["induced_offset_A"] = 0.0
    bench.error_Nm = 1.55
    assert 100 <= until_trip(bench, 150)[0] <= 103


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_high_pass_answers_an_offset_and_its_end(sign: float) -> None:
    """A rotor that is held: its torque comes, is taken for the mean, goes; the answer swings."""
    tau_s = 0.5
    bench = at_torque(0.0, torque_sensor={"highpass_time_constant_s": tau_s})
    held_Nm, mean_Nm = sign * most_Nm(bench), 0.0
    decay = math.exp(-1 / bench.config.loop.rate_Hz / tau_s)
    for torque_Nm, offsets_A in ((held_Nm, OFFSETS_A), (-held_Nm, OFFSETS_A), (0.0, np.zeros(3))):
        bench.setpoint["induced_offset_A"] = offsets_A
        for _ in range(1500):
            mean_Nm += (1.0 - decay) * (torque_Nm - mean_Nm)
            bench.error_Nm = torque_Nm - mean_Nm
            bench.ticks(1)
        assert bench.tick["state"][0] == State.ENABLED
    bench.error_Nm = 1.7
    assert until_trip(bench, 150)[0]


@pytest.mark.parametrize("name", ["induced_gain", "induced_offset_A"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_induced_errors_that_are_no_numbers_hide_no_torque_error_later(
    name: str, value: float
) -> None:
    bench = at_torque(3.0)
    bench.setpoint[name] = value
    bench.ticks(10)
    assert not bench.currents_A().any()
    bench.setpoint[name] = 0.0
    bench.ticks(5000)  # the torque that was lacking is forgotten
    bench.error_Nm = 2.15
    assert until_trip(bench, 150)[1] == Trip.TORQUE_IMPLAUSIBLE


@pytest.mark.kernel
def test_a_gain_that_is_induced_is_asked_for() -> None:
    bench = at_torque(3.0)
    bench.setpoint["induced_gain"] = 0.9
    bench.shown_Nm += 2.7  # at once, as the currents
    assert until_trip(bench, 150)[0] == 0


@pytest.mark.kernel
@pytest.mark.parametrize("dead", [False, True])
def test_a_step_of_the_torque_is_no_error_at_the_least_time_that_is_legal(dead: bool) -> None:
    """The drive takes 20 ms; what it does then is seen in the next tick, and one may be lost."""
    late = 21
    bench = Answering(
        limits={"torque_error_s": 0.0231, "torque_rate_Nm_per_s": 1e6},
        inverter={"actuation_delay_s": 0.02},
    )
    bench.enable()
    steps = [0.0] * late
    for tick in range(300):
        bench.setpoint["torque_Nm"] = (5.0, -5.0, 0.0)[tick // 100]
        steps.append(float(bench.memory["torque_set_Nm"][0]))
        bench.before_Nm, bench.shown_Nm = steps[-1], 0.0
        bench.error_Nm = 0.0 if dead else steps[-late]
        state = bench.ticks(1).state
        if state != State.ENABLED:
            break
    assert (state == State.TRIPPED) == dead
    assert not dead or Trip(int(bench.tick["first_trip"][0])) is Trip.TORQUE_IMPLAUSIBLE


@pytest.mark.kernel
def test_a_hot_brake() -> None:
    bench = at_torque(1.0)
    bench.setpoint["brake_temperature_C"] = bench.config.brake.temperature_max_C + 9.0
    assert until_trip(bench, 60)[0] == 0
    bench.setpoint["brake_temperature_C"] = bench.config.brake.temperature_max_C + 11.0
    assert until_trip(bench, 60) == (21, Trip.BRAKE_TEMPERATURE)


@pytest.mark.parametrize(("counts", "tracks"), [(4096, 11), (1024, 9), (4000, 10), (8, 2)])
def test_watched_tracks_change_twice_a_turn(counts: int, tracks: int) -> None:
    assert watched_tracks(counts) == tracks
    assert 2 << (tracks - 1) <= counts // 2 < 2 << tracks


@pytest.mark.kernel
@pytest.mark.parametrize("track", [3, 5])
@pytest.mark.parametrize("level", [0, 1])
def test_a_stuck_track_whose_jumps_are_plausible(track: int, level: int) -> None:
    bench = Answering(limits={"encoder_jump_rad": 0.3})
    bench.speed_rad_s = 4.4 if track == 5 else 1.0
    bench.enable()
    bench.ticks(50)
    bench.stuck = (1 << track, level << track)
    number, first = until_trip(bench, 600)
    assert first is Trip.ENCODER_IMPLAUSIBLE
    counts = number * 1e-3 * bench.speed_rad_s * 4096 / (2 * math.pi)
    assert counts < 4.0 * (2 << track)


@pytest.mark.kernel
@pytest.mark.parametrize("tripped", [False, True])
def test_a_stuck_track_of_before_enabling_is_not_found_after_it(tripped: bool) -> None:
    """Bit 9 mirrors what is read at 1535.5: 48 counts turned and a jump of 91, all in one pattern.

    The 51 counts to the pattern's end are less than is needed to find track 5 stuck, with them not.
    """
    bench = Answering(limits={"encoder_jump_rad": 0.5}, loop={"rate_Hz": 250})
    bench.angle_rad, bench.speed_rad_s = 1629 * 2 * math.pi / 4096, 0.0
    bench.stuck = (1 << 9, 1 << 9)
    bench.run()
    bench.enable()
    bench.speed_rad_s = -0.3
    bench.ticks(61)
    assert bench.memory["encoder_count"][0] == 1490
    bench.speed_rad_s = 0.0
    if tripped:
        bench.feedback["u_bus_V"] = 0.0
        assert until_trip(bench)[1] is Trip.BUS_VOLTAGE
    else:
        bench.ask(Request.STOP)
    bench.feedback["u_bus_V"], bench.stuck = 24.0, (0, 0)
    bench.ticks(100)
    assert bench.memory["encoder_count"][0] == 1581
    bench.ask(Request.RESET)
    bench.ticks(5)
    bench.enable()
    bench.speed_rad_s = 0.3
    assert until_trip(bench, 150) == (0, Trip(0))


ACCELERATION_MAX_RAD_S2 = 500.0
"""More than brake and motor together can do to the packaged rig's rotor."""


@given(
    speed_rad_s=st.floats(-19.0, 19.0),
    swing=st.floats(0.0, 1.0),
    hz=st.floats(0.2, 4.0),
    rate_Hz=st.sampled_from([100, 150, 200, 500, 1000]),
    seed=st.integers(0, 1000),
)
@settings(max_examples=examples(30))
def test_no_false_trips_in_normal_operation(
    speed_rad_s: float, swing: float, hz: float, rate_Hz: int, seed: int
) -> None:
    """Any speed within 5 % of the limit, turning back and forth as a rotor can, sensor noise."""
    bench = Answering(loop={"rate_Hz": rate_Hz})
    bench.speed_rad_s = 0.0
    bench.enable(torque_Nm=2.0, compensate=Compensate(0))
    draw = np.random.default_rng(seed)
    step_rad_s = ACCELERATION_MAX_RAD_S2 / rate_Hz
    for number in range(round(1.5 * rate_Hz)):
        wave = math.sin(2 * math.pi * hz * number / rate_Hz)
        wanted_rad_s = speed_rad_s * (1 - swing + swing * wave)
        ahead_rad_s = wanted_rad_s - bench.speed_rad_s
        bench.speed_rad_s += min(max(ahead_rad_s, -step_rad_s), step_rad_s)
        bench.error_A = draw.normal(0.0, 0.1, 3)
        bench.error_Nm = draw.normal(0.0, 0.1)
        tick = bench.ticks(1)
        assert tick.state == State.ENABLED, (number, Trip(int(tick.trip_bits)))


@pytest.mark.kernel
@pytest.mark.parametrize(
    ("tau_s", "part", "trips"),
    [
        (0.0, 0.99, True),
        (0.5, 0.99, True),
        (0.5, 1.2, False),
        (2.0, 0.99, True),
        (2.0, 1.02, False),
    ],
)
def test_a_sensor_that_stays_at_zero_trips_below_the_error_that_is_stated(
    tau_s: float, part: float, trips: bool
) -> None:
    """While the set-point rises more of it may pass the high-pass than once it is reached."""
    limits = {"torque_rate_Nm_per_s": 40.0, "torque_error_s": 0.1}
    sensor = {"highpass_time_constant_s": tau_s}
    config = make_config(limits=limits, torque_sensor=sensor)
    late_s = found_late_s(1000, 1000)
    limits["torque_error_Nm"] = part * dead_sensor_error_Nm(config.limits, tau_s, late_s)
    bench = Bench(make_config(limits=limits, torque_sensor=sensor))
    bench.enable(torque_Nm=config.limits.torque_Nm)
    bench.run(1000)
    assert bool(bench.tick["state"][0] == State.TRIPPED) is trips
    assert Trip(int(bench.tick["first_trip"][0])) is (Trip.TORQUE_IMPLAUSIBLE if trips else Trip(0))
