"""The rules of `config.rules.torque` against the kernel: no set-point trips, a dead sensor does."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from pydantic import ValidationError

from motord.config import Config
from motord.config.motor import back_emf_waves
from motord.config.rules.check_notes import false_trips
from motord.config.rules.torque import (
    dead_sensor_error_Nm,
    found_late_s,
    least_error_s,
    reversal_shows_Nm,
)
from motord.config.timing import TORQUE_SHARE
from motord.schema import State, Trip
from tests.unit.control.bench import Bench, make_config

IMPLAUSIBLE = Trip.TORQUE_IMPLAUSIBLE


def config_of(
    rate_Hz: int, sample_Hz: int, delay_s: float = 0.0, tau_s: float = 0.0, **limits: float
) -> Config:
    stale_s = {"stale_after_s": 0.2}
    return make_config(
        loop={"rate_Hz": rate_Hz},
        bridge={"rate_Hz": sample_Hz} | stale_s,
        inverter={"actuation_delay_s": delay_s} | stale_s,
        torque_sensor={"highpass_time_constant_s": tau_s},
        limits={"encoder_jump_rad": 1.5} | limits,
    )


class Sampled(Bench):
    """A bench whose torque follows after the drive's delay, in samples that may be lost.

    phase: of the first sample, in intervals. A sample shows what the set-point was that long ago,
    or nothing where the sensor is dead.
    """

    def __init__(self, config: Config, phase: float, dead: bool = False) -> None:
        super().__init__(config)
        self.parameters["current_error_A"] = 1e6
        self.run(5)
        self.enable()
        self.dead, self.speed_rad_s = dead, 0.0
        self.interval_ns = 1e9 / config.sample_rate_Hz
        self.sample_ns = self.now_ns + phase * self.interval_ns
        self.delay_ns = round(config.inverter.actuation_delay_s * 1e9)
        self.torques_Nm = [(0, 0.0)]

    def sampled_tick(self, loses: Callable[[float], bool]) -> bool:
        """Run a tick; loses: whether the sample that shows this torque is lost. False: tripped."""
        shown_ns = None
        while self.sample_ns <= self.now_ns + self.period_ns:
            shown_ns = round(self.sample_ns)
            self.sample_ns += self.interval_ns
        self.feedback["t_inverter_ns"] = self.now_ns + self.period_ns
        if shown_ns is not None:
            flowing = (Nm for ns, Nm in reversed(self.torques_Nm) if ns + self.delay_ns <= shown_ns)
            torque_Nm = 0.0 if self.dead else next(flowing)
            if not loses(torque_Nm):
                self.feedback["t_ns"], self.feedback["torque_Nm"] = shown_ns, torque_Nm
        self.run(healthy=False)
        self.torques_Nm.append((self.now_ns, self.set_Nm))
        return bool(self.tick["state"][0] == State.ENABLED)

    @property
    def set_Nm(self) -> float:
        return float(self.memory["torque_set_Nm"][0])

    @property
    def held_s(self) -> float:
        """For how long the torque has been astray, 0 where it is not."""
        held = int(self.memory["conditions_held"][0]) & IMPLAUSIBLE
        since_ns = int(self.memory["since_ns"][0, IMPLAUSIBLE.value.bit_length() - 1])
        return 1e-9 * (self.now_ns - since_ns) if held else 0.0


@pytest.mark.parametrize(
    ("rate_Hz", "sample_Hz", "delay_s"),
    [(1000, 400, 0.005), (200, 150, 0.02), (300, 100, 0.005), (100, 100, 0.02)],
)
@pytest.mark.parametrize("phase", [0.0, 0.35, 0.7])
def test_steps_do_not_trip_whose_good_sample_is_lost(
    rate_Hz: int, sample_Hz: int, delay_s: float, phase: float
) -> None:
    """Full steps as far apart as an error may last, one sample of those that are right lost."""
    limits = {"torque_error_Nm": 1.5, "torque_rate_Nm_per_s": 1e6}
    least_s = least_error_s(config_of(rate_Hz, sample_Hz, delay_s, **limits))
    bench = Sampled(config_of(rate_Hz, sample_Hz, delay_s, torque_error_s=least_s, **limits), phase)
    begun_ns, lost = bench.now_ns, False

    def loses(torque_Nm: float) -> bool:
        nonlocal lost
        lost = not lost and abs(torque_Nm - bench.set_Nm) < 1.5
        return lost

    for _ in range(math.ceil(12 * least_s * rate_Hz)):
        steps = int((bench.now_ns + bench.period_ns - begun_ns) * 1e-9 / least_s + 1e-9)
        bench.setpoint["torque_Nm"] = (-5.0, 5.0)[steps % 2]
        assert bench.sampled_tick(loses)


@pytest.mark.parametrize(
    ("rate_Hz", "rate_Nm_per_s", "error_Nm"), [(1000, 200.0, 1.0), (100, 60.0, 0.4)]
)
def test_a_ramp_that_would_be_an_error_is_refused(
    rate_Hz: int, rate_Nm_per_s: float, error_Nm: float
) -> None:
    """At the least time that is legal no ramp trips, and at half of it one does."""
    limits = {"torque_error_Nm": error_Nm, "torque_rate_Nm_per_s": rate_Nm_per_s}
    least_s = least_error_s(config_of(rate_Hz, rate_Hz, 0.02, torque_error_s=1.0, **limits))
    with pytest.raises(ValidationError, match=r"in a ramp of .* lower torque_rate_Nm_per_s"):
        config_of(rate_Hz, rate_Hz, 0.02, torque_error_s=0.99 * least_s, **limits)
    config = config_of(rate_Hz, rate_Hz, 0.02, torque_error_s=least_s, **limits)
    for part, target_Nm in ((1.0, 6.0), (1.0, 3.0), (0.5, 6.0)):
        bench = Sampled(config, 0.5)
        bench.parameters["lasts_ns"][0, IMPLAUSIBLE.value.bit_length() - 1] *= part
        states = []
        for ticks in range(2 * rate_Hz):
            bench.setpoint["torque_Nm"] = (-target_Nm, target_Nm)[ticks * 2 // rate_Hz % 2]
            states.append(bench.sampled_tick(lambda torque_Nm: False))
        assert all(states) == (part == 1.0)


@pytest.mark.parametrize(
    ("rate_Nm_per_s", "error_Nm", "remedy", "slower_Nm_per_s", "greater_Nm"),
    [
        (1.0, 0.01, "raise torque_error_Nm", 1.0, 0.25),
        (60.0, 0.01, "lower torque_rate_Nm_per_s and raise torque_error_Nm", 1.0, 0.25),
        (60.0, 0.23, "lower torque_rate_Nm_per_s", 1.0, 0.23),
    ],
)
def test_what_helps_against_a_ramp_that_would_be_an_error_helps(
    rate_Nm_per_s: float, error_Nm: float, remedy: str, slower_Nm_per_s: float, greater_Nm: float
) -> None:
    """Down to zero the torque ramps in a second at any rate: below it, a lower one is no help."""
    with pytest.raises(ValidationError, match=rf"make it at least [\d.]+, or {remedy} \["):
        config_of(100, 100, 0.02, torque_rate_Nm_per_s=rate_Nm_per_s, torque_error_Nm=error_Nm)
    config_of(100, 100, 0.02, torque_rate_Nm_per_s=slower_Nm_per_s, torque_error_Nm=greater_Nm)


@pytest.mark.parametrize(
    ("rate_Hz", "sample_Hz"), [(100, 100), (100, 150), (150, 100), (500, 333), (1000, 130)]
)
@pytest.mark.parametrize("tau_s", [0.3, 2.0])
@pytest.mark.parametrize("rate_Nm_per_s", [30.0, 1e9])
def test_a_dead_sensor_trips_at_any_rate_and_phase(
    rate_Hz: int, sample_Hz: int, tau_s: float, rate_Nm_per_s: float
) -> None:
    """One sample may be lost: the first after the ramp, or that which would trip."""
    limits = {"torque_error_s": 0.15, "torque_rate_Nm_per_s": rate_Nm_per_s}
    late_s = found_late_s(rate_Hz, sample_Hz)
    free = config_of(1000, 1000, 0.0, tau_s, torque_rate_Nm_per_s=rate_Nm_per_s).limits
    free = free.model_copy(update=limits)
    error_Nm = 0.999 * dead_sensor_error_Nm(free, tau_s, late_s)
    config = config_of(rate_Hz, sample_Hz, 0.0, tau_s, torque_error_Nm=error_Nm, **limits)
    ramp_Nm, lasting = rate_Nm_per_s * tau_s, math.exp(-(0.15 + late_s) / tau_s)
    best_Nm = min(ramp_Nm * math.log(lasting / TORQUE_SHARE), config.limits.torque_Nm)
    for phase, at_s in itertools.product((0.01, 0.35, 0.7, 0.99), (-1.0, 0.0, 0.15)):
        bench, lost = Sampled(config, phase, dead=True), False
        bench.setpoint["torque_Nm"] = best_Nm

        def loses(torque_Nm: float, bench: Sampled = bench, at_s: float = at_s) -> bool:
            nonlocal lost
            ramped = bench.set_Nm >= 0.999 * best_Nm
            loses = ramped and not lost and at_s >= 0 and bench.held_s >= at_s
            lost |= loses
            return loses

        ticks = range(round((best_Nm / rate_Nm_per_s + 1.0) * rate_Hz))
        assert not all(bench.sampled_tick(loses) for _ in ticks), (phase, at_s)
        assert Trip(int(bench.tick["first_trip"][0])) is IMPLAUSIBLE


@pytest.mark.parametrize("rate_Nm_per_s", [1.0, 10.0, 1e6])
@pytest.mark.parametrize("tau_s", [0.0, 0.1, 2.0])
def test_what_a_reversal_shows(rate_Nm_per_s: float, tau_s: float) -> None:
    """A high-pass that had settled, played in steps of 0.1 ms."""
    config = config_of(1000, 1000, 0.0, tau_s, torque_rate_Nm_per_s=rate_Nm_per_s)
    most_Nm, dt_s = config.limits.torque_Nm, 1e-4
    set_Nm = mean_Nm = -most_Nm
    shown_Nm, peak_Nm = most_Nm if tau_s == 0.0 else 0.0, 0.0
    while tau_s and set_Nm < most_Nm:
        ramp = config.limits.ramp_down_Nm_per_s if set_Nm < 0.0 else rate_Nm_per_s
        set_Nm = min(set_Nm + ramp * dt_s, most_Nm if set_Nm >= 0.0 else 0.0)
        shown_Nm = set_Nm - mean_Nm
        mean_Nm += shown_Nm * -math.expm1(-dt_s / tau_s)
        peak_Nm = max(peak_Nm, shown_Nm)
    assert reversal_shows_Nm(config) == pytest.approx(max(peak_Nm, shown_Nm), rel=2e-3)


@pytest.mark.parametrize(("trip_torque_Nm", "named"), [(9.0, True), (9.1, False)])
def test_a_reversal_that_trips_is_named(trip_torque_Nm: float, named: bool) -> None:
    """12 Nm at 10 Nm/s: a high-pass of 2 s shows 9.02 Nm."""
    config = config_of(1000, 1000, 0.0, 2.0, trip_torque_Nm=trip_torque_Nm)
    notes = [note for note in false_trips(config) if "OVER_TORQUE" in note]
    assert bool(notes) == named
    assert not named or "shows up to 9.02 Nm of it" in notes[0]


@pytest.mark.parametrize(
    ("tau_s", "error_Nm", "named"),
    [(2.0, 0.0183, True), (2.0, 0.0184, False), (0.0, 0.0283, True), (0.0, 0.0284, False)],
)
def test_a_torque_error_smaller_than_the_sensors_own_is_named(
    tau_s: float, error_Nm: float, named: bool
) -> None:
    """Friction changes by 0.3 % of 6 Nm, a count is 0.3 mNm; where it shows the mean its zero is
    10 mNm off."""
    limits = {"torque_error_Nm": error_Nm, "torque_rate_Nm_per_s": 1.0}
    notes = list(false_trips(config_of(1000, 1000, 0.0, tau_s, **limits)))
    assert bool(notes) == named
    assert not named or ("torque_zero_Nm" in notes[0]) == (tau_s == 0.0)
    assert not named or f"[limits] torque_error_Nm is {error_Nm:g}" in notes[0]


def commutation_notes(config: Config) -> list[str]:
    return [note for note in false_trips(config) if IMPLAUSIBLE.name in note]


@pytest.mark.kernel
@pytest.mark.parametrize(("counts", "named"), [(295, True), (305, False)])
def test_an_encoder_too_coarse_for_the_poles_is_named(counts: int, named: bool) -> None:
    """Half of the torque may be missing, 60 degrees: of 100 pole pairs half of 300 counts."""
    config = make_config(
        motor={"counts": counts, "pole_pairs": 100},
        limits={"encoder_jump_rad": 1.5, "trip_speed_rad_s": 10.0, "torque_error_Nm": 1.8},
    )
    assert bool(commutation_notes(config)) == named
    tripped = []
    for part in (-0.499, 0.0, 0.499):  # of a count, from the angle that the encoder says
        bench = Bench(config)
        bench.speed_rad_s, bench.angle_rad = 0.0, (70 + part) * 2 * math.pi / counts
        electrical_rad = np.array([100 * bench.angle_rad])
        [back_emf] = back_emf_waves(config.motor.back_emf, electrical_rad, "abc")
        bench.enable(torque_Nm=6.0)
        for _ in range(1500):
            bench.feedback["torque_Nm"] = back_emf @ bench.currents_A()
            bench.run()
        tripped.append(Trip(int(bench.tick["first_trip"][0])))
    assert tripped == ([IMPLAUSIBLE, Trip(0), IMPLAUSIBLE] if named else [Trip(0)] * 3)


@pytest.mark.parametrize(("trip_speed_rad_s", "named"), [(41.8, False), (42.0, True)])
def test_a_loop_too_slow_for_the_poles_is_named(trip_speed_rad_s: float, named: bool) -> None:
    """60 degrees in half of a period: 2.09 rad in 1 ms, of 50 pole pairs 41.9 rad/s."""
    config = make_config(
        motor={"pole_pairs": 50},
        limits={"encoder_jump_rad": 1.5, "trip_speed_rad_s": trip_speed_rad_s},
    )
    notes = commutation_notes(config)
    assert bool(notes) == named
    assert not named or "at more than 41.8 rad/s" in notes[0]
