"""Back-EMF of the phases from their voltages while the rotor is driven without current.

    u_p(t) = speed(t) k_p(theta(t)) + offset_p

by least squares over all speeds, speed and angle at the instant of the inverter's own sample: the
speed varies within the turn, and a voltage over mean speed would give what it varies by to the
back-EMF. With several speeds the age of the voltages beyond what the recording says is fitted too:
it turns the waves in proportion to the speed.
"""

from collections.abc import Iterable
from dataclasses import replace
from math import isnan

import numpy as np

from motord.config import MotorConfig
from motord.experiments.back_emf.between_speeds import (
    Average,
    Delay,
    average,
    counted_speeds,
    delay_with_scatter,
)
from motord.experiments.back_emf.encoder_error import EncoderError, encoder_errors
from motord.experiments.back_emf.encoder_error import lost as lost_by_encoder
from motord.experiments.back_emf.findings import SPEED_RATIO, findings
from motord.experiments.back_emf.result import MeasuredBackEmf
from motord.experiments.back_emf.trends import Captures, CaptureTrend, beyond_chance
from motord.experiments.back_emf.voltages import (
    COUNTS_PER_ORDER,
    VOLTAGES,
    VoltageSamples,
    check_pole_pairs,
    joined,
    spectra,
    voltage_samples,
)
from motord.experiments.magnet_temperature import UNKNOWN, ReferredBackEmf
from motord.identification import IdentifyError
from motord.identification.cluster_robust_ls import FEWEST_TURNS, ClusterFit, Regressors, first_rows
from motord.identification.operating_points import PointData
from motord.identification.orders import resolved_order
from motord.identification.rotor.driven_rotor import Driven, prepare
from motord.identification.rotor.left_out import LeftOut

MOST_HARMONICS = 31
"""Electrical orders that are fitted, at most."""

STANDS_OUT = 4.0
"""Amplitude, in standard errors, from which an electrical order is kept in the table."""

OTHER_STANDS_OUT = 6.0
"""The same for orders that are no multiple of the pole pairs."""

OTHER_SHARE = 5e-4
"""Part of the fundamental that such an order must have: what is smaller may be the encoder's."""

ENCODER_SHARE = 0.5
"""Part of the noise of independent cells that is left: samples meet them in a regular order."""

MOST_OTHERS = 16


def _columns(samples: VoltageSamples, order: np.ndarray) -> np.ndarray:
    """Return speed times cos and sin of each order, and 1 (n, 2 m + 1).

    Orders are multiples of the first but for a few: each wave is the one before times that.
    """
    columns = np.empty((samples.turn.size, 2 * order.size + 1))
    step = np.exp(1j * order[0] * samples.angle_rad)
    wave, before = samples.speed_rad_s.astype(complex), 0
    for place, h in enumerate(order):
        if h == before + order[0]:
            wave = wave * step
        else:
            wave = samples.speed_rad_s * np.exp(1j * h * samples.angle_rad)
        before = h
        columns[:, 2 * place], columns[:, 2 * place + 1] = wave.real, wave.imag
    columns[:, -1] = 1.0
    return columns


def fit_phases(samples: VoltageSamples, order: np.ndarray) -> list[ClusterFit]:
    """Return the fit of each phase: cos and sin of each order (V s/rad), then the offset (V)."""
    regressors = Regressors.of(_columns(samples, order), first_rows(samples.turn), FEWEST_TURNS)
    return [regressors.fit(u_V) for u_V in samples.u_V.T]


def fit_delay(samples: VoltageSamples, order: np.ndarray) -> tuple[float, float]:
    """Return by how much the voltages are older than the recording says, and its error (s).

    u(t) was k at theta - speed delay: the slope of k times speed^2 is one more column.
    """
    regressors = Regressors.of(_columns(samples, order), first_rows(samples.turn), FEWEST_TURNS)
    found = []
    for u_V in samples.u_V.T:
        fit = regressors.fit(u_V)
        a, b = fit.solution[:-1].reshape(-1, 2).T
        around = np.column_stack([order * b, -order * a]).ravel()
        slope = regressors.columns[:, :-1] @ around
        found.append(regressors.one_more(fit, -samples.speed_rad_s * slope))
    delay_s, variance = np.array(found).T
    weight = 1 / variance
    mean_s = float((weight * delay_s).sum() / weight.sum())
    return mean_s, float(np.sqrt(1 / weight.sum()))


def measure(points: Iterable[PointData], motor: MotorConfig) -> MeasuredBackEmf:
    """Return the back-EMF from driven points. Raises IdentifyError."""
    driven, left_out = prepare(points, motor, VOLTAGES, "no phase voltages")
    driven, unknown = _known(driven)
    left_out += unknown
    speeds = [one.speed_Hz for one in driven]
    order = _electrical_orders(driven, motor)
    delay, recorded = None, [voltage_samples(one, 0.0) for one in driven]
    check_pole_pairs(joined(recorded), driven, motor)
    if max(speeds) >= SPEED_RATIO * min(speeds):
        delay = fit_delay(joined(recorded), order)
    samples = [voltage_samples(one, delay[0] if delay else 0.0) for one in driven]
    fits = [fit_phases(one, order) for one in samples]
    lines = _residual_lines(samples, fits, driven, motor)
    fundamental = np.array([fit.solution[0] - 1j * fit.solution[1] for fit in fits[0]])
    encoder = encoder_errors(fundamental, lines, motor.pole_pairs)
    if others := _others(lines, fundamental, order):
        order = np.array(sorted({*order.tolist(), *others}))
        fits = [fit_phases(one, order) for one in samples]
    back_emf = ReferredBackEmf.of(motor, (one.back_emf_factor for one in driven))
    result = _result(fits, order, delay, encoder, driven, motor)
    result = replace(result, left_out=left_out, referred=back_emf)
    return replace(result, findings=findings(result, driven))


def _known(driven: list[Driven]) -> tuple[list[Driven], tuple[LeftOut, ...]]:
    """Return those with magnets of a known temperature, if it is asked for, and the others."""
    unknown = [one for one in driven if isnan(one.back_emf_factor)]
    if len(unknown) == len(driven):
        raise IdentifyError(
            f"{UNKNOWN} in any of the runs: repair its channel, or take "
            "back_emf_temperature_percent_per_K out of [motor]"
        )
    left_out = (
        LeftOut(one.label, UNKNOWN, 0.0, float(one.t_s[-1]), float(one.t_s[-1])) for one in unknown
    )
    return [one for one in driven if not isnan(one.back_emf_factor)], tuple(left_out)


def _electrical_orders(driven: list[Driven], motor: MotorConfig) -> np.ndarray:
    """Return the multiples of the pole pairs that every point samples."""
    fewest = min(one.samples_per_turn for one in driven)
    most = MOST_HARMONICS * motor.pole_pairs
    highest = resolved_order(fewest, motor.counts, most, counts_per_order=COUNTS_PER_ORDER)
    harmonics = highest // motor.pole_pairs
    if harmonics < 1:
        raise IdentifyError(
            f"{fewest} samples a turn cannot show {motor.pole_pairs} periods: turn slower or "
            "sample faster"
        )
    return motor.pole_pairs * np.arange(1, harmonics + 1)


def _residual_lines(
    samples: list[VoltageSamples],
    fits: list[list[ClusterFit]],
    driven: list[Driven],
    motor: MotorConfig,
) -> np.ndarray:
    """Return what the electrical orders leave at the orders 1 to n of the phases (3, n)."""
    every = joined(samples)
    residual = [np.concatenate([fit[phase].residual for fit in fits]) for phase in range(3)]
    return spectra(np.array(residual) / every.speed_rad_s, every.angle_rad, driven, motor)


def _others(lines: np.ndarray, fundamental: np.ndarray, order: np.ndarray) -> list[int]:
    """Return orders that are no multiple of the pole pairs and stand out of the noise.

    lines (3, n): what `order` leaves; fundamental (3,): its lines.
    """
    highest = lines.shape[1]
    ratio = np.zeros(highest)
    for size, first in zip(np.abs(lines), np.abs(fundamental), strict=True):
        least = OTHER_SHARE / OTHER_STANDS_OUT * first
        ratio = np.maximum(ratio, size / max(float(np.median(size)) / 1.177, least))
    ratio[order[order <= highest] - 1] = 0.0
    best = np.argsort(-ratio)[:MOST_OTHERS] + 1
    return [int(h) for h in best if ratio[h - 1] > OTHER_STANDS_OUT]


def _encoder_variance(driven: Driven, order: np.ndarray, pole_pairs: int) -> np.ndarray:
    """Return what the encoder's cells add to the variance of lines (n,), over the fundamental's.

    Order m of the angle's error makes an error m times as large of the speed, which shifts the
    fundamental's line by m either way, half of it each.
    """
    motion = driven.motion
    shift = np.stack([np.abs(order - pole_pairs), order + pole_pairs])
    shift = np.where(shift <= motion.ripple_orders, shift, 0)
    variance = (ENCODER_SHARE * 0.5 * motion.ripple_stderr_rad * shift) ** 2
    return np.asarray(variance.sum(axis=0))


def _result(
    fits: list[list[ClusterFit]],
    order: np.ndarray,
    turns_delay: tuple[float, float] | None,
    encoder: tuple[EncoderError, ...],
    driven: list[Driven],
    motor: MotorConfig,
) -> MeasuredBackEmf:
    cells = np.array([_encoder_variance(one, order, motor.pole_pairs) for one in driven])
    turns = tuple(len(one.turns) for one in driven)
    free = max(sum(turns) - len(turns), 1)
    with_age = turns_delay is not None
    speed = counted_speeds(_velocity_rad_s(driven), age_fitted=with_age)
    mean = average(fits, cells, free, speed=speed, age_fitted=with_age)
    kept, shown = _kept(mean, order, motor), _trends(mean, order, driven, motor)
    lost, scatter_stderr = lost_by_encoder(encoder, order), mean.stderr
    mean = mean.with_error(np.hypot(lost, beyond_chance(shown, order.size)))
    fundamental = int(np.flatnonzero(order == motor.pole_pairs)[0])
    of_turns = Delay(*turns_delay, free) if turns_delay else None
    delay = _delay(of_turns, mean, fundamental, driven, motor) if of_turns else None
    return MeasuredBackEmf(
        motor=motor,
        order=order,
        line=mean.line,
        stderr=mean.stderr,
        scatter_stderr=scatter_stderr,
        across_stderr=mean.across_stderr,
        mean_stderr=mean.mean_stderr,
        freedom=mean.freedom,
        phase_freedom=mean.phase_freedom,
        kept=kept,
        offset_V=np.mean([[fit.solution[-1] for fit in point] for point in fits], axis=0),
        delay_s=delay,
        noise_V=np.mean([[fit.noise for fit in point] for point in fits], axis=0),
        speeds_Hz=tuple(one.speed_Hz for one in driven),
        turns=turns,
        encoder=encoder,
        trends=shown,
    )


def _kept(mean: Average, order: np.ndarray, motor: MotorConfig) -> np.ndarray:
    """Return which orders (n,) stand out of the noise, and the fundamental.

    What takes a part off them, as an encoder's error does, leaves them in the table.
    """
    electrical = order % motor.pole_pairs == 0
    limit = np.where(electrical, STANDS_OUT, OTHER_STANDS_OUT)
    stands_out = (np.abs(mean.line) > limit[:, None] * mean.stderr).any(axis=1)
    return np.asarray(stands_out | (order == motor.pole_pairs))


def _trends(
    mean: Average, order: np.ndarray, driven: list[Driven], motor: MotorConfig
) -> tuple[CaptureTrend, ...]:
    """Return what the electrical orders differ by with time and frequency."""
    size, error = np.abs(mean.line).mean(axis=1), mean.mean_stderr[:, 0]
    shows = (order % motor.pole_pairs == 0) & (size > STANDS_OUT * error)
    time_s = np.array([float(one.ticks["t_ns"].mean()) for one in driven]) * 1e-9
    apart = np.where(shows, mean.apart, np.nan)
    captures = Captures(
        order, apart.real, apart.imag / order, mean.apart_variance, mean.share, time_s,
        _velocity_rad_s(driven),
    )  # fmt: skip
    return tuple(captures.trends())


def _velocity_rad_s(driven: list[Driven]) -> np.ndarray:
    return 2 * np.pi * np.array([one.direction * one.speed_Hz for one in driven])


def _delay(
    of_turns: Delay, mean: Average, fundamental: int, driven: list[Driven], motor: MotorConfig
) -> Delay:
    """Return the age with what the fundamental's phase differs by from speed to speed.

    fundamental: its place among the orders.
    """
    velocity_rad_s = _velocity_rad_s(driven)
    samples = np.array([one.turns[-1][1] - one.turns[0][0] for one in driven])
    arm = motor.pole_pairs * float(np.abs(mean.line[fundamental]).mean())
    return delay_with_scatter(
        of_turns,
        float(mean.between[fundamental]) / max(arm, 1e-300) ** 2,
        float(mean.phase_scatter[fundamental]),
        velocity_rad_s,
        samples * velocity_rad_s**2,
    )
