"""Quality of an operating point, from the observation at the end of its capture."""

from collections.abc import Iterator
from math import isnan

from motord.config import DrivenConfig, MeshConfig
from motord.sequencing.observation import Observation

GOOD = "ok"
"""Quality of an operating point that was taken as it should be."""

MEAN_TOLERANCES = 2.0
"""How far the mean speed may be off, in tolerances of speed."""
TURN_TOLERANCES = 3.0
"""How far the mean of any turn may be off."""
MISSING_PART = 0.2
"""Part of the periods that may be without a tick."""
ERRORS_PART = 0.01
"""Frames that may be lost or corrupt, for each tick."""


def quality(seen: Observation, band_C: tuple[float, float] | None, fault: str = "") -> str:
    """Return "ok", or what is wrong with a capture: `fault`, noise, the inverter's temperature."""
    faults = (fault, _noise(seen), _temperature_fault(seen, band_C))
    return "; ".join(filter(None, faults)) or GOOD


def quality_at_speed(
    seen: Observation, speed_Hz: float, settings: MeshConfig | DrivenConfig
) -> str:
    """Return the `quality` of a capture at `speed_Hz`."""
    faults = (
        _speed_fault(seen, speed_Hz, settings.speed_tolerance),
        *_warming(seen, settings.temperature_change_K),
    )
    return quality(seen, settings.temperature_C, "; ".join(filter(None, faults)))


def _speed_fault(seen: Observation, speed_Hz: float, tolerance: float) -> str:
    off = abs(seen.point_speed_Hz / speed_Hz - 1.0)
    if off > MEAN_TOLERANCES * tolerance:
        return f"speed off by {100 * off:.1f} %"
    range_Hz = (seen.point_slowest_Hz, seen.point_fastest_Hz)
    furthest = max(abs(turn_Hz / speed_Hz - 1.0) for turn_Hz in range_Hz)
    if furthest > TURN_TOLERANCES * tolerance:
        return f"not settled: turns from {range_Hz[0]:.3g} to {range_Hz[1]:.3g} Hz"
    return ""


def _noise(seen: Observation) -> str:
    periods = seen.point_ticks + seen.point_missed
    if seen.point_missed > MISSING_PART * periods:
        return f"{100 * seen.point_missed / periods:.0f} % of its ticks are missing"
    if seen.point_link_errors > ERRORS_PART * seen.point_ticks:
        return f"noisy: {seen.point_link_errors} frames lost or corrupt"
    return ""


def _warming(seen: Observation, limit_K: float | None) -> Iterator[str]:
    """Yield which temperatures of the motor moved further, or were not known all the time."""
    if limit_K is not None and not seen.point_temperatures_C:
        yield "temperature_change_K is set, and no channel has a role: no temperature is known"
    for name, span in seen.point_temperatures_C.items():
        if limit_K is None or span.change_K <= limit_K:
            continue
        if isnan(span.change_K):
            yield f"{name} was not known all the time"
        else:
            yield f"{name} moved by {span.change_K:.1f} K from {span.lowest_C:.1f} degC"


def _temperature_fault(seen: Observation, band_C: tuple[float, float] | None) -> str:
    if band_C is None or band_C[0] <= seen.temperature_C <= band_C[1]:
        return ""
    return f"inverter at {seen.temperature_C:.1f} degC, outside {band_C[0]:g} to {band_C[1]:g}"
