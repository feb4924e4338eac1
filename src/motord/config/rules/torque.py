"""What must hold of the torque's limits for the measured torque to tell a fault from a ramp."""

import math
from collections.abc import Iterator

from motord.config.bounds import SettingBound
from motord.config.sections import LimitsConfig, Sections
from motord.config.timing import (
    INTERVALS_MIN,
    RAMP_DOWN_MAX_S,
    SETTLING_LAGS,
    TORQUE_ERROR,
    TORQUE_SHARE,
)

SAMPLE_COUNTS_MAX = 2**31 - 1
"""Torque counts that a Sample of the bridge carries at most."""


def step_shows_s(config: Sections) -> float:
    """Return for how long a step of the set-point may seem an error.

    That is until the torque has settled, a tick, and two samples: one may be lost, and without it
    the error of a step would go on in that of the next one.
    """
    sample_s = INTERVALS_MIN * config.sample_interval_s
    return config.inverter.settling_s + 1.0 / config.loop.rate_Hz + sample_s


def ramp_behind_Nm(config: Sections) -> float:
    """Return by how much the torque is behind a set-point that ramps: by delay, tick and sample."""
    period_s, rate_Nm_per_s = 1.0 / config.loop.rate_Hz, config.limits.ramp_down_Nm_per_s
    behind_s = config.inverter.actuation_delay_s + period_s + config.sample_interval_s
    return rate_Nm_per_s * behind_s


def ramp_astray_s(config: Sections) -> float:
    """Return for how long the torque may be astray in a ramp between two set-points up to T.

    At the rate r it is b behind, allowed are e and a share s of the set-point: it is astray from
    -min(z, (T - e) / (1 + s)) on, where it would be b behind or is on its way there, until
    min(z, T + s (z - T)), z = (b - e) / s, the latter in units of r t beyond the ramp's end. Then
    what is left of a lag decays, and a high-pass tau takes back what it has taken for the mean: b
    (1 - exp(-t / tau)) after the time t, of which e is left after tau ln of their ratio.
    """
    limits, lag_s = config.limits, config.inverter.lag_s
    rate_Nm_per_s, most_Nm = limits.ramp_down_Nm_per_s, limits.torque_Nm
    error_Nm, behind_Nm = limits.greatest_torque_error_Nm, ramp_behind_Nm(config)
    if behind_Nm <= error_Nm:
        return 0.0
    edge_Nm = (behind_Nm - error_Nm) / TORQUE_SHARE
    begins_Nm = min(edge_Nm, (most_Nm - error_Nm) / (1.0 + TORQUE_SHARE))
    ends_Nm = min(edge_Nm, most_Nm + TORQUE_SHARE * (edge_Nm - most_Nm))
    step_Nm = min(behind_Nm, 2.0 * most_Nm)
    settles_s = max(float(SETTLING_LAGS), math.log(step_Nm / error_Nm) - 1.0) * lag_s
    astray_s = (begins_Nm + ends_Nm) / rate_Nm_per_s + settles_s
    tau_s = config.torque_sensor.highpass_time_constant_s
    if tau_s:
        mean_Nm = -step_Nm * math.expm1(-astray_s / tau_s)
        astray_s += tau_s * math.log(max(mean_Nm / error_Nm, 1.0))
    return astray_s + config.sample_interval_s


def least_error_s(config: Sections) -> float:
    """Return the least `torque_error_s` at which no set-point is an error."""
    return max(step_shows_s(config), ramp_astray_s(config))


def counts_resolve_the_limits(config: Sections) -> Iterator[str]:
    """A count of the torque is no error by itself, and a Sample can carry the torque that trips.

    Named is what the file says of the count, or the limit if it says nothing. More would be to know
    the converter's bits, which the board does not state: torque beyond its end is not valid
    (`TORQUE_STALE`), too little of it is not that of the set-point.
    """
    limits, part = config.limits, _written_part_of_count(config)
    is_error = "one count would be a torque error (torque_error_Nm)"
    reaches_none = "no number of counts would reach trip_torque_Nm"
    if part is None:
        yield from _limits_fit_the_count(config, is_error, reaches_none)
        return
    name, given, other, times = part
    at, most = f"with {other} = {times:g}", limits.greatest_torque_error_Nm / times
    least = limits.trip_torque_Nm / (SAMPLE_COUNTS_MAX * times)
    yield from SettingBound(
        name, given, "at most", most, "too large", f"{at} {is_error}", f"lower {other}"
    ).refusal()
    yield from SettingBound(
        name, given, "at least", least, "too small", f"{at} {reaches_none}", f"raise {other}"
    ).refusal()


def _limits_fit_the_count(config: Sections, is_error: str, reaches_none: str) -> Iterator[str]:
    limits, count_Nm = config.limits, config.torque_Nm_per_count
    of = f"of {count_Nm:.3g} Nm ([bridge] adc_V_per_count, [torque_sensor] gain_Nm_per_V)"
    name, given_Nm, share = "torque_error_Nm", limits.greatest_torque_error_Nm, 1.0
    if limits.torque_error_Nm is None:
        name, given_Nm, share = "torque_Nm", limits.torque_Nm, TORQUE_ERROR
    yield from SettingBound(
        f"[limits] {name}", given_Nm, "at least", count_Nm / share, "too small",
        f"{is_error}: {of}", "measure finer",
    ).refusal()  # fmt: skip
    yield from SettingBound(
        "[limits] trip_torque_Nm", limits.trip_torque_Nm, "at most", SAMPLE_COUNTS_MAX * count_Nm,
        "too large", f"{reaches_none}: {of}",
    ).refusal()  # fmt: skip


def _written_part_of_count(config: Sections) -> tuple[str, float, str, float] | None:
    """Return what the bench file says of the torque of a count, and what it is multiplied by."""
    bridge, sensor = config.bridge, config.torque_sensor
    volts = "[bridge] adc_V_per_count", bridge.adc_V_per_count
    gain = "[torque_sensor] gain_Nm_per_V", sensor.gain_Nm_per_V
    if "adc_V_per_count" in bridge.model_fields_set:
        return *volts, *gain
    return (*gain, *volts) if "gain_Nm_per_V" in sensor.model_fields_set else None


def no_set_point_is_an_error(config: Sections) -> Iterator[str]:
    """No step and no ramp of the set-point lasts so long that its torque is an error."""
    limits, inverter = config.limits, config.inverter
    ramp_s = ramp_astray_s(config)
    why, remedy = (
        "a step of the torque would trip before it shows, after [inverter] actuation_delay_s, "
        f"{SETTLING_LAGS} lag_s, a tick and two samples, of which one may be lost",
        "",
    )
    if ramp_s > step_shows_s(config):
        rate_Nm_per_s = limits.ramp_down_Nm_per_s
        behind_Nm = min(ramp_behind_Nm(config), 2.0 * limits.torque_Nm)
        why, remedy = (
            f"in a ramp of {rate_Nm_per_s:g} Nm/s the torque is {behind_Nm:.3g} Nm behind its "
            f"set-point, more than torque_error_Nm, and this for up to {ramp_s:.3g} s, with "
            f"[inverter] actuation_delay_s = {inverter.actuation_delay_s:g}, a tick, a sample and "
            "what a high-pass of the torque sensor makes of it",
            _gentler(config),
        )
    yield from SettingBound(
        "[limits] torque_error_s", limits.torque_error_s, "at least", least_error_s(config),
        "too short", why, remedy, 1.0,
    ).refusal()  # fmt: skip


def _gentler(config: Sections) -> str:
    """Return what helps against ramps: not their rate alone where the ramp down is as fast anyway.

    At its own rate the torque is behind by much less than torque_error_Nm may be at most.
    """
    limits, remedies = config.limits, []
    down_Nm_per_s = limits.torque_Nm / RAMP_DOWN_MAX_S
    if limits.torque_rate_Nm_per_s > down_Nm_per_s:
        remedies = ["lower torque_rate_Nm_per_s"]
    slowest = limits.model_copy(update={"torque_rate_Nm_per_s": down_Nm_per_s})
    slowest_s = ramp_astray_s(config.model_copy(update={"limits": slowest}))
    if slowest_s > max(limits.torque_error_s, step_shows_s(config)):
        remedies.append("raise torque_error_Nm")
    return " and ".join(remedies)


def reversal_shows_Nm(config: Sections) -> float:
    """Return the most torque that the sensor shows of a change from -torque_Nm to torque_Nm.

    A high-pass tau has taken the first for its mean: the ramp down to zero, at its own rate, and
    that up to T each leave r tau (1 - exp(-T / (r tau))), and exp(-T / (r tau)) of before.
    """
    limits, tau_s = config.limits, config.torque_sensor.highpass_time_constant_s
    if not tau_s:
        return limits.torque_Nm
    shown_Nm = most_Nm = 0.0
    for rate_Nm_per_s in (limits.ramp_down_Nm_per_s, limits.torque_rate_Nm_per_s):
        ramp_Nm = rate_Nm_per_s * tau_s
        shown_Nm += (ramp_Nm - shown_Nm) * -math.expm1(-limits.torque_Nm / ramp_Nm)
        most_Nm = max(most_Nm, shown_Nm)
    return most_Nm


def found_late_s(rate_Hz: float, sample_rate_Hz: float) -> float:
    """Return by how much later than `torque_error_s` after a ramp's end its error may be found.

    A tick, as the kernel compares with the set-point of the one before, and until the next sample
    at the beginning and at the end of that time, in ticks, of which one may be lost.
    """
    ticks = math.ceil(rate_Hz / min(rate_Hz, sample_rate_Hz) - 1e-9)
    return (1 + (INTERVALS_MIN + 1) * ticks) / rate_Hz


def dead_sensor_error_Nm(
    limits: LimitsConfig, highpass_time_constant_s: float, late_s: float
) -> float:
    """Return the torque_error_Nm below which a torque sensor that stays at zero trips for sure.

    At the set-point T up to torque_Nm that shows it best; a share of T is allowed anyway. A
    high-pass of the sensor with the time constant tau leaves r tau (1 - exp(-T / (r tau))) of it
    when it is reached at the rate r, and exp(-t / tau) of that after the time t that the error may
    last and `late_s` (`found_late_s`). Their difference is largest at
    T = r tau ln(exp(-t / tau) / share).
    """
    tau_s, most_Nm = highpass_time_constant_s, limits.torque_Nm
    if not tau_s:
        return (1.0 - TORQUE_SHARE) * most_Nm
    ramp_Nm = limits.torque_rate_Nm_per_s * tau_s
    lasting = math.exp(-(limits.torque_error_s + late_s) / tau_s)
    if lasting <= TORQUE_SHARE:
        return 0.0
    best_Nm = min(ramp_Nm * math.log(lasting / TORQUE_SHARE), most_Nm)
    return -ramp_Nm * math.expm1(-best_Nm / ramp_Nm) * lasting - TORQUE_SHARE * best_Nm
