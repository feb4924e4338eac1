"""What sampling folds into the torque, against a simulation in fine steps."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import signal

from motord.config import BackEmfHarmonic, MotorConfig, TorqueSensorConfig
from motord.identification.aliased_ripple import (
    IMAGE_STANDARD_UNCERTAINTY,
    ZeroOrderHold,
    aliased_ripple,
    image_torques,
    with_images,
    without_aliases,
)
from motord.identification.basis import cell_gain
from motord.identification.operating_points import Samples
from motord.identification.point_ripple import point_ripple, rms_error_percent
from motord.identification.torque.torque_sensor import response

COUNTS, SPEED_HZ, PERIOD_S, FINE = 1000, 1.0, 1e-3, 40
MOTOR = MotorConfig(
    name="m",
    pole_pairs=5,
    slots=15,
    counts=COUNTS,
    rated_torque_Nm=2.0,
    connection="independent",
    back_emf=(BackEmfHarmonic(order=1, amplitude_V_s_per_rad=0.2),),
)
HOLD = ZeroOrderHold(dead_s=0.2e-3, lag_s=0.15e-3, period_s=PERIOD_S)


def commands(angle_rad: np.ndarray) -> np.ndarray:
    lag = 2 * np.pi / 3 * np.arange(3)
    turned = angle_rad[:, None]
    return np.asarray(4 * np.sin(5 * turned - lag) + 1.5 * np.sin(35 * turned - 7 * lag + 0.3))


def fine_torque(
    direction: int = 1, hold: ZeroOrderHold = HOLD
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return angle, currents (n, 3) and their torque over two turns, in FINE steps a period."""
    samples = 2 * round(1 / PERIOD_S)
    t_s = np.arange(samples * FINE) * PERIOD_S / FINE
    held = commands(2 * np.pi * direction * SPEED_HZ * np.arange(samples) * PERIOD_S)
    tick = np.floor((t_s - hold.dead_s) / PERIOD_S + 1e-9).astype(int)
    wanted_A = held[np.maximum(tick, 0)]
    decay = np.exp(-PERIOD_S / FINE / hold.lag_s)
    current_A = signal.lfilter([0, 1 - decay], [1, -decay], wanted_A, axis=0)
    angle_rad = 2 * np.pi * direction * SPEED_HZ * t_s
    lag = 2 * np.pi / 3 * np.arange(3)
    torque_Nm = (0.2 * np.sin(5 * angle_rad[:, None] - lag) * current_A).sum(axis=1)
    return angle_rad, current_A, torque_Nm


@cache
def fine_reading(
    sensor: TorqueSensorConfig, direction: int = 1
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return angle, sensor's torque and torque over two turns, in FINE steps a period."""
    angle_rad, _, torque_Nm = fine_torque(direction)
    t_s = np.arange(torque_Nm.size) * PERIOD_S / FINE
    w = 2 * np.pi * sensor.resonance_Hz
    mount = ([w * w], [1, 2 * sensor.damping_ratio * w, w * w])
    seen_Nm = signal.lsim(mount, torque_Nm - torque_Nm[-1], t_s)[1]
    found = angle_rad, seen_Nm, torque_Nm
    for one in found:
        one.flags.writeable = False  # of several tests
    return found


def simulated(
    sensor: TorqueSensorConfig, direction: int = 1
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return angle and sensor's torque at the samples of the second of two turns.

    And the torque in fine steps of this turn.
    """
    angle_rad, seen_Nm, torque_Nm = fine_reading(sensor, direction)
    half = torque_Nm.size // 2
    return angle_rad[half::FINE], seen_Nm[half::FINE], torque_Nm[half:]


def as_samples(angle_rad: np.ndarray, seen_Nm: np.ndarray, every: int = 1) -> Samples:
    """Return the point as of a board that samples in one period of the loop of so many."""
    angle_rad, seen_Nm = angle_rad[::every], seen_Nm[::every]
    count = np.rint(angle_rad / (2 * np.pi) * COUNTS).astype(int) % COUNTS
    return Samples(
        torque_set_Nm=1.0,
        speed_set_Hz=SPEED_HZ,
        compensate=7,
        t_s=np.arange(count.size) * PERIOD_S * every,
        count=count,
        torque_Nm=seen_Nm,
        i_A=commands(angle_rad),
        command_A=commands(angle_rad),
        turns=((0, count.size),),
    )


@pytest.mark.parametrize("every", [1, 2, 4])
@pytest.mark.parametrize("resonance_Hz", [700.0, 2500.0])
def test_sensor_shows_the_torque_and_its_folded_images(resonance_Hz: float, every: int) -> None:
    sensor = TorqueSensorConfig(resonance_Hz=resonance_Hz, damping_ratio=0.1)
    angle_rad, seen_Nm, _ = simulated(sensor)
    samples = as_samples(angle_rad, seen_Nm, every)
    angle_rad, seen_Nm = angle_rad[::every], seen_Nm[::every]
    order = np.array([30])
    images_Nm = image_torques(samples, np.ones(3), MOTOR, HOLD)
    predicted = aliased_ripple(samples, images_Nm, sensor, HOLD, order)
    turn = np.exp(-1j * np.outer(order, angle_rad))
    shown = 2 / angle_rad.size * (turn @ seen_Nm) / response(sensor, order * SPEED_HZ)
    assert np.abs(predicted).min() > 0.005
    # the torque itself: the commands' as they are held, delayed and lagged
    real = np.array([base(o) for o in order])
    np.testing.assert_allclose(shown - predicted, real, atol=0.02 * np.abs(predicted).max() + 5e-4)


@pytest.mark.parametrize("resonance_Hz", [700.0, 2500.0])
@pytest.mark.parametrize(("oldest", "youngest"), [(0.25, 0.25), (0.0, 0.5), (1.0, 0.0)])
def test_images_turn_with_the_age_of_the_samples(
    oldest: float, youngest: float, resonance_Hz: float
) -> None:
    """As of a board that samples by its own clock: parts of a period, from first to last."""
    sensor = TorqueSensorConfig(resonance_Hz=resonance_Hz, damping_ratio=0.1)
    angle_rad, seen_Nm, _ = fine_reading(sensor)
    ticks = np.arange(angle_rad.size // 2, angle_rad.size, FINE)
    late = np.rint(FINE * np.linspace(oldest, youngest, ticks.size)).astype(int)
    sampled_rad, sampled_Nm = angle_rad[ticks - late], seen_Nm[ticks - late]
    samples = replace(
        as_samples(sampled_rad, sampled_Nm),
        command_A=commands(angle_rad[ticks]),
        sample_age_s=late * PERIOD_S / FINE,
    )
    order = np.array([30])
    images_Nm = image_torques(samples, np.ones(3), MOTOR, HOLD)
    predicted = aliased_ripple(samples, images_Nm, sensor, HOLD, order)
    turn = np.exp(-1j * np.outer(order, sampled_rad))
    shown = 2 / ticks.size * (turn @ sampled_Nm) / response(sensor, order * SPEED_HZ)
    np.testing.assert_allclose(shown - predicted, base(30), atol=1e-3)
    as_if_new = replace(samples, sample_age_s=None)
    images_Nm = image_torques(as_if_new, np.ones(3), MOTOR, HOLD)
    wrong = aliased_ripple(as_if_new, images_Nm, sensor, HOLD, order)
    assert np.abs(wrong - predicted).min() > 3e-3


@pytest.mark.parametrize("every", [1, 2])
@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("resonance_Hz", [700.0, 2500.0])
def test_the_rms_has_the_images_as_they_are_on_the_shaft(
    resonance_Hz: float, direction: int, every: int
) -> None:
    sensor = TorqueSensorConfig(resonance_Hz=resonance_Hz, damping_ratio=0.1)
    angle_rad, seen_Nm, torque_Nm = simulated(sensor, direction)
    samples = as_samples(angle_rad, seen_Nm, every)
    seen = point_ripple(samples, MOTOR, sensor)
    images_Nm = image_torques(samples, np.ones(3), MOTOR, HOLD)
    freed = without_aliases(seen, samples, images_Nm, MOTOR, sensor, HOLD)
    found = with_images(freed, images_Nm, MOTOR)
    true_percent = rms_error_percent(torque_Nm, MOTOR.rated_torque_Nm)
    lines_Nm = np.array([base(order) for order in range(1, 100)])
    base_percent = 100 / MOTOR.rated_torque_Nm * float(np.linalg.norm(lines_Nm) / np.sqrt(2))
    images = found.rms_percent**2 - freed.rms_percent**2
    assert images == pytest.approx(true_percent**2 - base_percent**2, rel=0.02)
    assert found.stderr_percent is None  # of one turn
    shown = np.abs(freed.line_Nm[:99] * cell_gain(freed.order[:99], COUNTS))
    np.testing.assert_allclose(shown, np.abs(lines_Nm), atol=2e-3)


def test_an_order_at_the_rate_of_the_loop_is_none_of_the_images() -> None:
    """Its image would be at 0 Hz. The period is a power of two, so that it is so exactly."""
    motor = MOTOR.model_copy(update={"counts": 2 * COUNTS})
    sensor = TorqueSensorConfig(resonance_Hz=700.0, damping_ratio=0.1)
    samples = as_samples(*simulated(sensor)[:2])
    t_s, hold = np.arange(samples.count.size) / 1024, replace(HOLD, period_s=1 / 1024)
    samples = replace(samples, count=2 * samples.count, t_s=t_s)
    assert COUNTS * samples.velocity_Hz == 1 / hold.period_s
    order = np.array([30])
    images_Nm = image_torques(samples, np.ones(3), motor, hold)
    assert np.isfinite(aliased_ripple(samples, images_Nm, sensor, hold, order)).all()


@pytest.mark.parametrize("stderr_percent", [0.0, 0.5])
def test_the_interval_of_the_square_stays_and_that_of_the_images_comes_on_top(
    stderr_percent: float,
) -> None:
    sensor = TorqueSensorConfig(resonance_Hz=700.0, damping_ratio=0.1)
    samples = as_samples(*simulated(sensor)[:2])
    ripple = replace(point_ripple(samples, MOTOR, sensor), stderr_percent=stderr_percent)
    found = with_images(ripple, image_torques(samples, np.ones(3), MOTOR, HOLD), MOTOR)
    above, below = (ripple.rms_percent + stderr_percent) ** 2, ripple.rms_percent**2
    images = found.rms_percent**2 - below
    noise_percent = np.sqrt(above + images) - found.rms_percent
    doubt_percent = IMAGE_STANDARD_UNCERTAINTY * images / found.rms_percent
    assert found.stderr_percent == pytest.approx(np.hypot(noise_percent, doubt_percent))
    assert found.noise_stderr_percent == found.stderr_percent


def base(order: int) -> complex:
    """Return the line at `order` of the torque that the currents make without images."""
    angle_rad = 2 * np.pi * np.arange(COUNTS) / COUNTS
    spectrum = np.fft.fft(commands(angle_rad), axis=0)
    turned = np.fft.fftfreq(COUNTS, 1 / COUNTS)
    passed = np.nan_to_num(HOLD.image(turned + 1e-12, 0), nan=1.0)
    current_A = np.fft.ifft(spectrum * passed[:, None], axis=0)
    torque = np.fft.fft((current_A * MOTOR.back_emf_table()).sum(axis=1))
    return complex(2 / COUNTS * torque[order])


@pytest.mark.parametrize(
    ("periods", "folded"),
    [(0.1, False), (0.5, False), (0.96, True), (1.0, True), (1.5, False), (1.96, True)],
)
def test_images_are_folded_by_samples_a_whole_number_of_periods_apart(
    periods: float, folded: bool
) -> None:
    angle_rad = 2 * np.pi * np.arange(COUNTS) / COUNTS
    samples = as_samples(angle_rad, angle_rad)
    apart = replace(samples, t_s=periods * samples.t_s)
    assert HOLD.is_folded_by(apart) == folded
    assert not replace(HOLD, dead_s=np.nan).is_folded_by(apart)


def test_a_steady_current_has_no_images() -> None:
    frequency_Hz = np.array([0.0])
    assert HOLD.image(frequency_Hz, 1)[0] == 0
