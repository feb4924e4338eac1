"""From the fit to time constants, resistances, capacities and steady temperatures with intervals.

Standard errors by the delta method; intervals of what is positive are those of its logarithm. The
uncertainty of the heat, which scales all resistances and capacities alike, is in theirs (Type B).
"""

from collections.abc import Callable
from dataclasses import replace
from math import exp, hypot, sqrt

import numpy as np

from motord.experiments.thermal.estimate import ThermalFit
from motord.experiments.thermal.result import (
    SEPARATED,
    HeatCapacity,
    Phase,
    SteadyTemperature,
    ThermalConstants,
    ThermalResistance,
    TimeConstant,
    rms,
    unseparated,
)
from motord.intervals import IntervalEstimate, coverage_factor

REACHED = 0.02
"""Part of the rise that may be missing at the end of a heat-up that counts as steady."""


def constants_of(fit: ThermalFit) -> ThermalConstants:
    """Return the constants of a fit, without findings."""
    course, known = fit.course, fit.copper.known
    (total,), (stderr,) = fit.of(lambda one: one.network.steady_rise_K(1.0)[:1])
    ohm, uncertainty = fit.copper.ohm, fit.copper.heat_uncertainty
    (ambient_C,), (ambient_stderr_C,) = fit.of(lambda one: np.array([one.ambient_C]))
    end_C = _end_of_heating(fit)
    heat_W = float(fit.copper.heat_W(np.array([course.heating_A2]), end_C[:1])[0])
    found = ThermalConstants(
        nodes=course.nodes,
        channels=tuple(each.channel for each in course.readings.values()),
        time_constants=(*_time_constants(fit, "cooling", 0.0), *_heating_constants(fit)),
        resistance_K_per_W=_positive(total, stderr, uncertainty, fit.freedom)
        if known
        else IntervalEstimate(),
        rise=_positive(total * ohm, stderr * ohm, 0.0, fit.freedom),
        resistances=_resistances(fit) if known else (),
        capacities=_capacities(fit) if known else (),
        steady=_steady(fit, end_C),
        ambient_C=float(ambient_C),
        ambient_stderr_C=float(ambient_stderr_C),
        ambient_measured=course.ambient is not None,
        current_rms_A=sqrt(course.heating_A2 / 3),
        heat_W=heat_W if known else None,
        heating_s=course.heating_s,
        cooling_s=course.duration_s - course.heating_s,
        ended_by=course.ended_by,
        residual_K=tuple(rms(each) for each in fit.residuals_K),
        notes=(),
        fit=fit,
    )
    if found.noise_free:
        found = _without_intervals(found)
    return replace(found, notes=tuple(_notes(found)))


def _without_intervals(found: ThermalConstants) -> ThermalConstants:
    """Return the constants without the intervals that are of the fit alone."""

    def unknown(one: IntervalEstimate) -> IntervalEstimate:
        return IntervalEstimate(one.value)

    return replace(
        found,
        time_constants=tuple(
            replace(one, time_constant_s=unknown(one.time_constant_s))
            for one in found.time_constants
        ),
        rise=unknown(found.rise),
        steady=tuple(replace(one, steady_C=unknown(one.steady_C)) for one in found.steady),
        ambient_stderr_C=None,
    )


def _positive(value: float, stderr: float, relative: float, freedom: int) -> IntervalEstimate:
    """Return the interval of the logarithm; relative: further standard uncertainty, in parts.

    freedom: degrees of freedom of stderr.
    """
    in_parts = hypot(stderr / value, relative)
    factor = exp(min(coverage_factor(freedom) * in_parts, 50.0))
    ends = float(value / factor), float(value * factor)
    return IntervalEstimate(float(value), float(value * in_parts), *ends)


def _time_constants(
    fit: ThermalFit, phase: Phase, feedback_W_per_K: float
) -> tuple[TimeConstant, ...]:
    found, stderr = fit.of(lambda one: 1.0 / one.network.rates_per_s(feedback_W_per_K))
    return tuple(
        TimeConstant(phase, number, _positive(*pair, 0.0, fit.freedom))
        for number, pair in enumerate(zip(found, stderr, strict=True), start=1)
    )


def _heating_constants(fit: ThermalFit) -> tuple[TimeConstant, ...]:
    """Return those of the heat-up, none where the loss rises faster than heat flows off."""
    if fit.network.rates_per_s(fit.feedback_W_per_K)[0] <= 0:
        return ()
    return _time_constants(fit, "heat-up", fit.feedback_W_per_K)


def _by_heat(
    fit: ThermalFit, derived: Callable[[ThermalFit], np.ndarray]
) -> list[tuple[IntervalEstimate, bool]]:
    """Return what goes with the heat, and whether the data separate it from the others."""
    doubt = fit.copper.heat_uncertainty
    return [
        (_positive(value, error, doubt, fit.freedom), bool(error < SEPARATED * value))
        for value, error in zip(*fit.of(derived), strict=True)
    ]


def _resistances(fit: ThermalFit) -> tuple[ThermalResistance, ...]:
    found = _by_heat(fit, lambda one: 1.0 / one.network.conductance_W_per_K)
    links = zip(fit.network.links, found, strict=True)
    return tuple(ThermalResistance(f"{one} - {other}", *each) for (one, other), each in links)


def _capacities(fit: ThermalFit) -> tuple[HeatCapacity, ...]:
    found = _by_heat(fit, lambda one: one.network.capacity_J_per_K)
    return tuple(HeatCapacity(n, *each) for n, each in zip(fit.course.nodes, found, strict=True))


def _end_of_heating(fit: ThermalFit) -> np.ndarray:
    """Return the fitted temperatures when the current ended (n,)."""
    ends = [
        np.interp(fit.course.heating_s, each.t_s, fitted)
        for each, fitted in zip(fit.course.readings.values(), fit.fitted_C, strict=True)
    ]
    return np.array(ends)


def steady_C(fit: ThermalFit) -> np.ndarray:
    """Return where the temperatures end (n,) with the mean current of the heat-up."""
    copper, squares_A2 = fit.copper, np.array([fit.course.heating_A2])
    at_ambient_W = float(copper.heat_W(squares_A2, np.array([fit.ambient_C]))[0])
    return fit.ambient_C + fit.network.steady_rise_K(at_ambient_W, fit.feedback_W_per_K)


def _steady(fit: ThermalFit, end_C: np.ndarray) -> tuple[SteadyTemperature, ...]:
    channels = [each.channel for each in fit.course.readings.values()]
    if fit.network.rates_per_s(fit.feedback_W_per_K)[0] <= 0:
        return tuple(
            SteadyTemperature(channel, float(end), IntervalEstimate(), extrapolated=True)
            for channel, end in zip(channels, end_C, strict=True)
        )
    found, stderr = fit.of(steady_C)
    half = coverage_factor(fit.freedom) * stderr
    rise_K = np.maximum(np.abs(found - fit.ambient_C), 1e-9)
    missing = np.abs(found - end_C) / rise_K
    return tuple(
        SteadyTemperature(
            channel,
            float(end),
            IntervalEstimate(float(value), float(error), float(value - h), float(value + h)),
            extrapolated=bool(part > REACHED),
        )
        for channel, end, value, error, h, part in zip(
            channels, end_C, found, stderr, half, missing, strict=True
        )
    )


def _notes(found: ThermalConstants) -> list[str]:
    """Return what is worth knowing of the result, in sentences."""
    notes = []
    if found.heat_W is None:
        notes.append(
            "the winding's resistance is not known, so neither is the heat: time constants only; "
            "name resistance_ohm in [plans.thermal] of a bench file with -c"
        )
    else:
        notes.append(
            "the heat is the copper loss of the measured currents alone: iron loss and friction "
            "that heat the motor, too, make resistances look larger"
        )
    notes.append(
        "errors of the thermometers are in no interval: a gain of all that is off by 1 % makes "
        "K/W and J/K wrong by as much; gains and offsets that differ from channel to channel move "
        "time constants, too"
    )
    if not found.ambient_measured:
        notes.append(
            f"the ambient is fitted as constant, {found.ambient_C:.2f} degC"
            f"{found.ambient_error_text('+-')}; name ambient_channel to measure it"
        )
    if found.nodes[0] != "winding":
        notes.append(
            f"the winding is not measured: its resistance is taken at the temperature of the "
            f"{found.nodes[0]}, and the heat enters there"
        )
    notes += [
        f"{one.channel}: {one.end_C:.1f} degC at the end of the heat-up, its steady temperature "
        f"{one.steady_C.value:.1f} degC is extrapolated"
        for one in found.steady
        if one.steady_C.value is not None and one.extrapolated
    ]
    if lost := [*unseparated(found.resistances), *unseparated(found.capacities)]:
        notes.append(
            f"not separated by these data (standard error above {100 * SEPARATED:.0f} %): "
            f"{', '.join(lost)}; their sums over all paths are still known"
        )
    if len(found.nodes) < 3:
        notes.append(
            f"nodes: {', '.join(found.nodes)}; what is not measured counts to its neighbours"
        )
    return notes
