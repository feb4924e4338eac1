"""Powers, losses and efficiency of captures whose powers are known; intervals that hold them."""

from dataclasses import replace

import numpy as np
import pytest

from motord.config import AccuracyConfig, TorqueSensorConfig
from motord.experiments.subject import Subject
from motord.experiments.torque_speed.estimate import operating_power
from motord.experiments.torque_speed.findings import ACCURACIES, findings
from motord.experiments.torque_speed.power_series import PowerSeries, resolution_of
from motord.experiments.torque_speed.recordings import bus_voltage
from motord.experiments.torque_speed.result import OperatingPower
from motord.experiments.torque_speed.turns import CapturedTurns
from motord.experiments.torque_speed.uncertainty import (
    ErrorSum,
    Scatter,
    freedom_of_blocks,
    sampling_error_W,
    scatter_of,
)
from motord.identification import IdentifyError
from motord.intervals import IntervalEstimate, coverage_factor
from tests.unit.experiments.torque_speed.captures import ACCURACY, MOTOR, Machine

EXACT = AccuracyConfig(
    torque_gain_percent=0.0, torque_zero_Nm=0.0, power_gain_percent=0.0, power_zero_W=0.0
)


def found(
    machine: Machine, every_s: float = 0.2, means: bool = True, accuracy: AccuracyConfig = ACCURACY
) -> OperatingPower:
    rng = np.random.default_rng(7)
    series = machine.readings(rng, every_s, means)
    return operating_power(
        machine.torque_Nm, machine.speed_Hz, machine.turns(rng), series, accuracy, 8
    )


@pytest.mark.parametrize(
    ("value", "half", "text"),
    [
        (0.001, 0.0002, "0.00100 +- 0.00020"),
        (12.142, 0.342, "12.14 +- 0.34"),
        (1234.56, 250.0, "1235 +- 250"),
    ],
)
def test_a_power_has_the_digits_of_its_interval(value: float, half: float, text: str) -> None:
    assert IntervalEstimate(value, half / 2, value - half, value + half).text() == text


@pytest.mark.parametrize("means", [True, False])
def test_powers_and_efficiency_of_a_motor(means: bool) -> None:
    machine = Machine()
    one = found(machine, means=means)
    mechanical_W = machine.mechanical_W()
    assert one.mode == "motoring"
    assert one.mechanical.value == pytest.approx(mechanical_W, rel=1e-3)
    assert one.loss.value == pytest.approx(machine.loss_W, abs=0.2)
    efficiency = 100 * mechanical_W / (mechanical_W + machine.loss_W)
    assert one.efficiency.value == pytest.approx(efficiency, rel=2e-3)
    assert one.torque_mean_Nm == pytest.approx(3.0015, rel=1e-3)
    assert one.speed_mean_Hz == pytest.approx(4.0, rel=1e-4)
    for each in (one.mechanical, one.electrical, one.loss, one.efficiency):
        assert each.low < each.value < each.high
        fewest = coverage_factor(freedom_of_blocks(one.blocks))
        assert 1.5 * each.stderr < each.high - each.value < fewest * each.stderr


def test_power_is_the_mean_of_the_product_not_the_product_of_means() -> None:
    machine = Machine(ripple_Nm=1.5, speed_ripple=0.1, noise_Nm=0.0)
    one = found(machine, accuracy=EXACT)
    apart_W = one.mechanical.value - 2 * np.pi * 4.0 * 3.0
    assert apart_W == pytest.approx(2 * np.pi * 4.0 * 0.5 * 1.5 * 0.1, rel=0.02)


def test_a_generator_is_efficient_by_what_it_gives() -> None:
    machine = Machine(torque_Nm=-3.0)
    one = found(machine)
    mechanical_W = machine.mechanical_W()
    assert one.mode == "generating"
    assert one.electrical.value == pytest.approx(mechanical_W + 20.0, rel=1e-3)
    assert one.efficiency.value == pytest.approx(100 * (1 + 20.0 / mechanical_W), rel=2e-3)
    assert one.efficiency_reason == ""


@pytest.mark.parametrize(
    ("machine", "mode", "reason"),
    [
        (Machine(torque_Nm=-0.5, loss_W=30.0), "braking", "all of it is lost"),
        (Machine(torque_Nm=-0.01, ripple_Nm=0.0, loss_W=0.1), "generating", "is near zero"),
        (Machine(torque_Nm=0.001, ripple_Nm=0.0, loss_W=0.1), "motoring", "is near zero"),
        (Machine(torque_Nm=0.01, ripple_Nm=0.0, loss_W=-30.0), "motoring", "is below zero"),
    ],
)
def test_near_zero_power_losses_are_stated_and_no_efficiency(
    machine: Machine, mode: str, reason: str
) -> None:
    one = found(machine)
    assert reason in one.efficiency_reason
    assert one.efficiency.value is None
    assert one.loss.value == pytest.approx(machine.loss_W, abs=0.2)
    assert all(share.efficiency_percent is None for share in one.budget)
    assert mode in (one.mode, "generating")


def test_each_source_is_in_the_budget_as_its_formula_says() -> None:
    one = found(Machine())
    shares = {share.source: share for share in one.budget}
    mechanical_W, electrical_W = one.mechanical.value, one.electrical.value
    assert mechanical_W is not None
    assert electrical_W is not None
    efficiency = one.efficiency.value
    assert shares["torque sensor, gain"].loss_W == pytest.approx(0.002 / 3**0.5 * mechanical_W)
    assert shares["torque sensor, zero"].loss_W == pytest.approx(
        0.005 / 3**0.5 * 2 * np.pi * one.speed_mean_Hz
    )
    assert shares["power reading, gain"].loss_W == pytest.approx(0.002 / 3**0.5 * electrical_W)
    assert shares["power, zero"].loss_W == pytest.approx(0.05 / 3**0.5)
    for name in ("torque sensor, gain", "power reading, gain"):
        assert shares[name].efficiency_percent == pytest.approx(0.002 / 3**0.5 * efficiency)
    total_W = np.sqrt(sum(share.loss_W**2 for share in one.budget))
    assert one.loss.stderr == pytest.approx(total_W)


def test_slow_readings_cost_uncertainty() -> None:
    fast, slow = (found(Machine(seconds_s=40.0), every_s=s, means=False) for s in (0.02, 0.5))
    assert slow.sampling_W > 100 * fast.sampling_W
    assert slow.electrical.stderr > 5 * fast.electrical.stderr
    assert slow.efficiency.stderr > 5 * fast.efficiency.stderr
    shares = {share.source: share.loss_W for share in slow.budget}
    assert shares["slow readings of the power"] == slow.sampling_W


def test_readings_in_step_with_the_rotor_are_seen_by_their_course() -> None:
    """Scatter between turns shows nothing of it: each turn is read at the same angles."""
    machine = Machine(ripple_order=5, noise_Nm=0.0, seconds_s=20.0, speed_ripple=0.0)
    at_s = np.arange(1.03, 19.0, 0.25 / 5)  # 5 readings a turn
    t_s, _, _, energy_J = machine.path()
    series = PowerSeries(at_s, np.interp(at_s, t_s, np.gradient(energy_J, t_s)), means=False)
    turns = machine.turns(np.random.default_rng(1))
    one = operating_power(3.0, 4.0, turns, series, EXACT, 8)
    amplitude_W = 0.3 * 2 * np.pi * 4.0
    assert one.sampling_W == pytest.approx(amplitude_W / 2**0.5, rel=0.1)
    true_W = 2 * np.pi * 4.0 * 3.0 + 20.0
    assert turns.in_step(series.t_s, 5) == pytest.approx(1.0, abs=0.01)
    assert abs(one.electrical.value - true_W) > 0.5
    assert one.electrical.low < true_W < one.electrical.high
    edges_s = turns.t_s[turns.edges[4:-5]]
    assert sampling_error_W(turns, replace(series, means=True), edges_s) < 0.05 * amplitude_W


def test_a_drift_is_no_scatter_and_is_stated() -> None:
    steady, drifting = (
        found(Machine(seconds_s=30.0, loss_rate_W_per_s=rate)) for rate in (0.0, 0.2)
    )
    assert drifting.loss_drift_W == pytest.approx(0.2 * 28, rel=0.1)
    assert drifting.loss_drift_W > 10 * drifting.loss_drift_stderr_W
    assert drifting.loss.stderr < 1.1 * steady.loss.stderr + 0.05


@pytest.mark.parametrize("rho", [-0.5, 0.0, 0.6])
def test_standard_errors_hold_for_blocks_that_depend_on_the_one_before(rho: float) -> None:
    rng, ratios = np.random.default_rng(3), []
    for _ in range(400):
        noise = rng.standard_normal(40)
        for n in range(1, 40):
            noise[n] = rho * noise[n - 1] + (1 - rho**2) ** 0.5 * noise[n]
        ratios.append((noise.mean(), scatter_of(noise).stderr))
    errors, stderrs = np.array(ratios).T
    assert 0.8 < np.sqrt((stderrs**2).mean()) / errors.std() < 1.3


@pytest.mark.parametrize("number", [4, 6, 8, 20, 40])
def test_student_s_t_of_few_blocks_holds_their_mean(number: int) -> None:
    rng, held = np.random.default_rng(4), []
    for values in rng.standard_normal((2000, number)):
        found = scatter_of(values)
        held.append(abs(values.mean()) < coverage_factor(found.freedom) * found.stderr)
    assert found.freedom == freedom_of_blocks(number)
    assert 0.935 < np.mean(held) < 0.965


@pytest.mark.parametrize(
    ("rectangular", "stderr", "half_width"),
    [(1.0, 0.0, 0.95), (0.0, 1.0, coverage_factor(3)), (3**0.5, 1.0, 3.62)],
)
def test_intervals_are_of_the_sum_s_distribution(
    rectangular: float, stderr: float, half_width: float
) -> None:
    """The last from 4 million draws; 1.96 times the root of the sum of squares would be 2.8."""
    errors = ErrorSum((rectangular,), (0.0,), Scatter(stderr, 3, 0.0, 0.0))
    assert errors.half_width == pytest.approx(half_width, rel=0.03)


@pytest.mark.parametrize(
    ("number", "blocks_a_beat"),
    [(18, 2.3), (18, 3.1), (18, 4.6), (39, 2.3), (39, 3.1), (39, 4.6), (39, 7.7)],
)
def test_a_beat_that_averages_out_is_hardly_scatter(number: int, blocks_a_beat: float) -> None:
    """Of random phase. Blocks that were independent would have 0.7 / sqrt(number)."""
    phases_rad = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    beats = np.cos(2 * np.pi * np.arange(number) / blocks_a_beat + phases_rad[:, None])
    error = np.sqrt(np.mean(beats.mean(axis=1) ** 2))
    stated = np.sqrt(np.mean([scatter_of(values).stderr ** 2 for values in beats]))
    assert error < stated < 0.6 * 0.5**0.5 / number**0.5


def test_instants_of_a_ripple_have_the_uncertainty_of_their_mean() -> None:
    """Read at any phase; intervals from independent blocks are 5 times as wide."""
    machine, errors_W, stderrs_W = Machine(speed_Hz=4.4, noise_Nm=0.0), [], []
    turns = machine.turns(np.random.default_rng(1))
    for seed in range(20):
        series = machine.readings(np.random.default_rng(seed), 0.2, means=False)
        one = operating_power(3.0, 4.4, turns, series, EXACT, 8)
        errors_W.append(one.electrical.value - machine.mechanical_W() - machine.loss_W)
        stderrs_W.append(one.electrical.stderr)
    error_W, stderr_W = (np.sqrt(np.mean(np.square(each))) for each in (errors_W, stderrs_W))
    assert error_W < stderr_W < 3 * error_W


def rounded(series: PowerSeries, step_W: float) -> PowerSeries:
    power_W = step_W * np.round(series.power_W / step_W)
    return replace(series, power_W=power_W, resolution_W=step_W)


def test_coarse_readings_are_uncertain_by_half_a_step() -> None:
    machine = Machine(ripple_Nm=0.0, speed_ripple=0.0)
    rng = np.random.default_rng(7)
    turns, fine = machine.turns(rng), machine.readings(rng, 0.2)
    for loss_W in np.linspace(20.0, 24.0, 9):
        series = rounded(replace(fine, power_W=fine.power_W + loss_W - 20.0), 4.0)
        one = operating_power(3.0, 4.0, turns, series, ACCURACY, 8)
        assert one.loss.low < loss_W < one.loss.high
        shares = {share.source: share.loss_W for share in one.budget}
        assert shares["power reading, resolution"] == pytest.approx(2.0 / 3**0.5)


def test_steps_that_readings_are_spread_over_cost_nothing() -> None:
    steady_W, rng = np.full(40, 100.2), np.random.default_rng(2)
    series = PowerSeries(np.arange(40.0), steady_W, means=True)
    assert rounded(series, 1.0).rounding_W == 0.5
    between = replace(series, power_W=100.5 + 0.1 * rng.standard_normal(40))
    assert rounded(between, 1.0).rounding_W == 0.5
    spread = replace(series, power_W=100.2 + 0.8 * rng.standard_normal(40))
    assert rounded(spread, 1.0).rounding_W == 0.0
    assert series.rounding_W == 0.0


@pytest.mark.parametrize(
    ("values", "step"),
    [([1.2, 1.3, 1.1, 1.3], 0.1), ([5.0, 5.0], 0.0), ([0.3, 0.1 + 0.2, 0.8], 0.5), ([], 0.0)],
)
def test_the_resolution_is_the_smallest_step(values: list[float], step: float) -> None:
    assert resolution_of(np.array(values)) == pytest.approx(step)


@pytest.mark.parametrize(
    ("error_deg", "coupling_Nm", "named"),
    [(0.0, 0.0, False), (1.0, 0.0, False), (0.0, 0.5, False), (1.0, 0.5, True)],
)
def test_an_eccentric_encoder_and_a_coupling_out_of_line_are_in_the_interval_and_named(
    error_deg: float, coupling_Nm: float, named: bool
) -> None:
    """The sensor shows the coupling once a turn, in phase with the seeming ripple of the speed."""
    machine, rng = Machine(), np.random.default_rng(3)
    point = machine.captured(rng)
    _, angle_rad, _, _ = machine.path()
    read_rad = angle_rad + np.radians(error_deg) * np.sin(angle_rad)
    point.ticks["encoder_count"] = np.floor(read_rad / (2 * np.pi) * MOTOR.counts) % MOTOR.counts
    point.ticks["torque_Nm"] += coupling_Nm * np.cos(angle_rad)
    turns = CapturedTurns.of(point, MOTOR)
    one = operating_power(3.0, 4.0, turns, machine.readings(rng, 0.2), EXACT, 8)
    no_power_W = 0.5 * coupling_Nm * np.radians(error_deg) * 2 * np.pi * 4.0
    assert one.shaft_ripple_W == pytest.approx(no_power_W, rel=0.05, abs=2e-3)
    assert one.loss.low < machine.loss_W < one.loss.high
    names = [each.name for each in findings([one], accurate(**STATED))]
    assert names == ["shaft-ripple"] * named


@pytest.mark.parametrize("noise_V", [0.0, 0.02])
@pytest.mark.parametrize("ripple_V", [0.0, 0.5])
def test_white_noise_of_the_bus_voltage_is_no_ripple(noise_V: float, ripple_V: float) -> None:
    rng = np.random.default_rng(2)
    turns = Machine().turns(rng)
    ticks = Machine().captured(rng).ticks
    phase_rad = 2 * np.pi * 41.3 * 1e-9 * (ticks["t_ns"] - ticks["t_ns"][0])
    ticks["u_bus_V"] += ripple_V * np.sin(phase_rad) + noise_V * rng.standard_normal(ticks.size)
    at_s = np.arange(1.0, 10.0, 0.2)
    mean_V, rms_V = bus_voltage(turns, ticks, at_s, means=True)
    assert mean_V == pytest.approx(24.0, abs=0.02)
    assert rms_V == pytest.approx(ripple_V / 2**0.5, rel=0.01, abs=0.3 * noise_V + 1e-9)
    assert bus_voltage(turns, ticks, at_s, means=False)[1] == 0.0


@pytest.mark.parametrize("change", ["lost", "not a number"])
def test_a_gap_that_may_hide_a_turn_is_refused(change: str) -> None:
    """At 4 Hz a turn takes 0.25 s: the power of 12 s with 0.3 s in a gap was 2 % too small."""
    point = Machine().captured(np.random.default_rng(1))
    gap = slice(6000, 6300)
    if change == "lost":
        point = replace(point, ticks=np.delete(point.ticks, gap))
    else:
        point.ticks["torque_Nm"][gap] = np.nan
    with pytest.raises(IdentifyError, match=r"0\.301 s without usable samples.* about 1\.2 turns"):
        CapturedTurns.of(point, MOTOR)


@pytest.mark.parametrize(
    ("seconds_s", "every_s", "message"),
    [
        (3.0, 1.0, "blocks of turns with 2 readings"),
        (12.0, 9.0, "0 readings of the power; at least 2 are needed"),
    ],
)
def test_too_few_readings_are_refused(seconds_s: float, every_s: float, message: str) -> None:
    machine = Machine(seconds_s=seconds_s)
    at_s = np.arange(0.1, seconds_s, every_s)
    series = PowerSeries(at_s if at_s.size > 2 else at_s - 20, np.ones(at_s.size), means=True)
    with pytest.raises(IdentifyError, match=message):
        operating_power(3.0, 4.0, machine.turns(np.random.default_rng(1)), series, ACCURACY, 8)


def test_missing_readings_are_refused() -> None:
    machine = Machine()
    whole = machine.readings(np.random.default_rng(1), 0.2)
    kept = np.abs(whole.t_s - 6.0) > 1.0
    series = PowerSeries(whole.t_s[kept], whole.power_W[kept], means=True)
    with pytest.raises(IdentifyError, match="no reading of the power for 2"):
        operating_power(3.0, 4.0, machine.turns(np.random.default_rng(1)), series, ACCURACY, 8)


def trial(seed: int, means: bool) -> tuple[bool, bool]:
    """Return whether losses and efficiency are in their intervals, with errors as stated."""
    rng = np.random.default_rng(seed)
    machine = Machine(
        ripple_order=int(rng.integers(3, 30)),
        speed_Hz=rng.uniform(3.0, 5.0),
        ripple_Nm=0.3 if means else 0.05,
    )
    a = ACCURACY
    turns = machine.turns(
        rng,
        1 + a.torque_gain_percent / 100 * rng.uniform(-1, 1),
        a.torque_zero_Nm * rng.uniform(-1, 1),
    )
    read = machine.readings(rng, rng.uniform(0.1, 0.4), means, noise_W=0.3)
    power_W = read.power_W * (1 + a.power_gain_percent / 100 * rng.uniform(-1, 1))
    power_W = power_W + a.power_zero_W * rng.uniform(-1, 1)
    series = PowerSeries(read.t_s, power_W, means)
    one = operating_power(machine.torque_Nm, machine.speed_Hz, turns, series, a, 8)
    mechanical_W = machine.mechanical_W()
    efficiency = 100 * mechanical_W / (mechanical_W + machine.loss_W)
    return (
        one.loss.low < machine.loss_W < one.loss.high,
        one.efficiency.low < efficiency < one.efficiency.high,
    )


@pytest.mark.parametrize("means", [True, False])
def test_intervals_hold_the_truth_in_about_95_of_100_trials(means: bool) -> None:
    loss, efficiency = np.mean([trial(seed, means) for seed in range(100)], axis=0)
    assert 0.90 <= loss <= 0.99
    assert 0.90 <= efficiency <= 0.99


def test_readings_that_may_be_of_before_or_after_do_not_count() -> None:
    series = PowerSeries(np.arange(11.0), np.arange(11.0), means=True)
    assert series.within(2.0, 8.0).t_s.tolist() == [3.0, 4.0, 5.0, 6.0, 7.0]


def test_means_reach_back_to_the_reading_before_and_instants_are_joined() -> None:
    t_s, power_W = np.array([0.0, 1.0, 2.0]), np.array([9.0, 1.0, 3.0])
    edges_s = np.array([0.5, 1.5])
    assert PowerSeries(t_s, power_W, means=True).means_W(edges_s)[0] == pytest.approx(2.0)
    assert PowerSeries(t_s, power_W, means=False).means_W(edges_s)[0] == pytest.approx(2.25)


def test_counts_of_a_recording_rise_forwards_whichever_way_the_encoder_counts() -> None:
    machine, rng = Machine(), np.random.default_rng(7)
    point = machine.captured(rng)
    backwards = MOTOR.model_copy(update={"encoder_direction": -1})
    turns = CapturedTurns.of(point, backwards)
    one = operating_power(3.0, 4.0, turns, machine.readings(rng, 0.2), ACCURACY, 8)
    assert one.mechanical.value == pytest.approx(machine.mechanical_W(), rel=1e-3)


def accurate(**stated: float) -> Subject:
    return Subject("b", MOTOR, TorqueSensorConfig(resonance_Hz=200.0), AccuracyConfig(**stated))


STATED = dict.fromkeys(ACCURACIES, 0.01)


def test_findings_say_what_intervals_do_not_hold() -> None:
    subject, good = accurate(**STATED), found(Machine())
    assert findings([good], subject) == ()
    assert [one.name for one in findings([good], accurate())] == ["accuracy-assumed"]
    unfiltered = replace(subject, sensor=TorqueSensorConfig())
    (between,) = findings([good], unfiltered)
    assert between.name == "torque-between-ticks"
    assert between.value == pytest.approx(100 * (2 * np.pi * 8 * 4.0 * 1e-3) ** 2 / 12, rel=0.01)
    negative = found(Machine(loss_W=-5.0))
    (wrong,) = findings([negative], subject)
    assert (wrong.name, wrong.severity) == ("negative-losses", "serious")
    for part, names in ((0.75, []), (0.65, ["torque-scale"]), (1000.0, ["torque-scale"])):
        scaled = replace(good, torque_mean_Nm=part * good.torque_Nm)
        assert [one.name for one in findings([scaled, scaled], subject)] == names
    drifting = found(Machine(seconds_s=30.0, loss_rate_W_per_s=0.2))
    assert [one.name for one in findings([drifting], subject)] == ["losses-drift"]
    for in_step, readings, names in (
        (0.5, 400, ["readings-in-step"]), (0.5, 9, []), (0.2, 400, []),
    ):  # fmt: skip
        stuck = replace(good, in_step=in_step, readings=readings)
        assert [one.name for one in findings([stuck], subject)] == names
    for stderrs, names in ((4.0, []), (5.0, ["losses-drift"])):  # t of 4 degrees: 4.6
        drift_W = 0.1 * (good.loss.value or 0.0)
        moved = {"loss_drift_W": drift_W, "loss_drift_stderr_W": drift_W / stderrs, "blocks": 40}
        assert [one.name for one in findings([replace(good, **moved)], subject)] == names
    half_W = (good.loss.high or 0.0) - (good.loss.value or 0.0)
    for part, names in ((0.9, []), (1.1, ["losses-drift"])):  # as large as the interval
        moved = {"loss_drift_W": part * half_W, "loss_drift_stderr_W": 0.01 * half_W, "blocks": 40}
        assert [one.name for one in findings([replace(good, **moved)], subject)] == names
        moved["loss_drift_stderr_W"] = part * half_W / 5.5  # as one of many points has by chance
        assert not findings([replace(good, **moved), *[good] * 31], subject)
    slow = replace(good, sampling_W=0.9 * (good.electrical.stderr or 0.0))
    assert [one.name for one in findings([slow], subject)] == ["slow-readings"]
