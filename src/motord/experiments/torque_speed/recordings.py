"""Operating points with their electrical power, from recordings.

Where readings of the DC current are means, mean(u i) = mean(u) mean(i) + the mean product of their
ripples, which is at most that of their RMS values. Of the bus voltage's variance within readings,
white noise of its sensor is no ripple.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from motord.config import TorqueSensorConfig
from motord.experiments.captures_left_out import CapturesLeftOut
from motord.experiments.signal_findings import signal_findings
from motord.experiments.subject import AnalysisError, Recordings, check_plan, plan_settings
from motord.experiments.torque_speed import NAME, TorqueSpeedConfig
from motord.experiments.torque_speed.estimate import operating_power
from motord.experiments.torque_speed.findings import findings
from motord.experiments.torque_speed.power_series import PowerSeries, resolution_of
from motord.experiments.torque_speed.result import EfficiencyMap, OperatingPower
from motord.experiments.torque_speed.turns import COLUMNS, CapturedTurns
from motord.identification import IdentifyError
from motord.identification.disturbances.noise_floor import noise_floor
from motord.identification.operating_points import PointData, good_points, split
from motord.identification.signal_condition import SignalFault
from motord.recording.plan_columns import plan_columns
from motord.recording.reader import Run, bounds_of

Readings = tuple[np.ndarray, np.ndarray, float]
"""Times (n,), Unix ns, values (n,) and their resolution."""


def efficiency_map(recordings: Recordings) -> EfficiencyMap:
    """Return the powers of all good points. Raises AnalysisError, ConfigError, RecordError."""
    runs, subject = recordings.runs, recordings.subject
    for run in runs:
        check_plan(run, NAME)
    _check_mean(subject.sensor)
    accuracy, pole_pairs = subject.accuracy, subject.motor.pole_pairs
    points: list[OperatingPower] = []
    sources: dict[str, None] = {}
    left_out = CapturesLeftOut()
    faults: list[tuple[str, tuple[SignalFault, ...]]] = []
    for run in runs:
        own = plan_settings(replace(recordings, runs=(run,)), NAME, TorqueSpeedConfig)
        sources[own.bus_current_channel or own.power_channel] = None
        readings, plan = _readings(run, own), plan_columns(run.metadata)
        for point, envelope_Nm in _captured(run):
            with left_out.noted(point.label, point.began):
                turns = CapturedTurns.of(point, subject.motor)
                faults.append((point.label, turns.faults))
                series = _series(readings, turns, point, own)
                place = (point.torque_Nm, point.speed_Hz)
                found = operating_power(*place, turns, series, accuracy, pole_pairs)
                points.append(replace(found, envelope_Nm=envelope_Nm, plan=plan))
    if not points:
        files = ", ".join(str(run.path) for run in runs)
        raise AnalysisError(f"{files}: no good operating point{left_out.as_text}")
    of_captures = (*signal_findings(faults), *left_out.findings(runs))
    all_findings = (*findings(points, subject), *of_captures)
    return EfficiencyMap(tuple(points), ", ".join(sources), left_out.reasons, all_findings)


def _check_mean(sensor: TorqueSensorConfig) -> None:
    if sensor.highpass_time_constant_s > 0:
        raise AnalysisError(
            "the torque sensor has a high-pass ([torque_sensor] highpass_time_constant_s = "
            f"{sensor.highpass_time_constant_s:g}): it does not show the mean torque, without "
            "which there is no mechanical power; use a sensor that passes the mean"
        )


def _captured(run: Run) -> Iterator[tuple[PointData, float | None]]:
    """Yield the points of good quality with the envelope that the plan had for them."""
    columns = [name for name in COLUMNS if name in run.columns]
    for point in good_points(run.operating_points()):
        envelope = point.get("envelope_Nm")
        for one in split(run.ticks(columns, **bounds_of(point)), [point], run.path.name):
            yield one, None if envelope is None else float(envelope)


def _readings(run: Run, own: TorqueSpeedConfig) -> Readings:
    """Return the valid readings of the channel with the power or the current."""
    name = own.bus_current_channel or own.power_channel
    if name not in run.channels():
        known = ", ".join(run.channels()) or "none"
        raise AnalysisError(
            f"{run.path}: has no channel {name} with the DC power; it has {known}; name it in "
            "[plans.torque-speed] power_channel or bus_current_channel"
        )
    t_ns, values = run.channel(name)
    valid = np.isfinite(values)
    return t_ns[valid], values[valid], resolution_of(values[valid])


def _series(
    readings: Readings, turns: CapturedTurns, point: PointData, own: TorqueSpeedConfig
) -> PowerSeries:
    """Return the power over the time of a capture. Raises IdentifyError."""
    t_ns, values, resolution = readings
    t_s = (t_ns - turns.t0_ns) * 1e-9
    near = np.flatnonzero((t_s >= turns.t_s[0]) & (t_s <= turns.t_s[-1]))
    t_s, values = t_s[near], values[near]
    means, ripple_W = own.readings == "means", 0.0
    if own.bus_current_channel:
        bus_V, ripple_V = bus_voltage(turns, point.ticks, t_s, means)
        ripple_W = ripple_V * float(np.sqrt(np.mean(values**2))) if ripple_V else 0.0
        values, resolution = values * bus_V, resolution * float(np.abs(bus_V).max(initial=0.0))
    return PowerSeries(t_s, values, means, resolution, ripple_W)


def bus_voltage(
    turns: CapturedTurns, ticks: np.ndarray, at_s: np.ndarray, means: bool
) -> tuple[np.ndarray, float]:
    """Return the voltage (m,) at readings (m,), V, and the RMS of its ripple, V.

    means: the voltage is the mean since the reading before; else it is that of an instant, and no
    ripple is lost. Raises IdentifyError where the drive does not report it.
    """
    names = ticks.dtype.names or ()
    voltage_V = ticks["u_bus_V"].astype(float) if "u_bus_V" in names else np.zeros(0)
    if not voltage_V.size or not np.isfinite(voltage_V).all() or not voltage_V.any():
        raise IdentifyError("the ticks have no bus voltage (u_bus_V) to multiply the current with")
    tick_s = (ticks["t_ns"].astype(np.int64) - turns.t0_ns) * 1e-9
    if not means or at_s.size < 2:
        return np.interp(at_s, tick_s, voltage_V), 0.0
    between_V = PowerSeries(tick_s, voltage_V, means=False).means_W(at_s)
    place = np.searchsorted(at_s, tick_s)
    inside = (place > 0) & (place < at_s.size)
    apart_V = voltage_V[inside] - between_V[place[inside] - 1]
    square_V2 = float(np.mean(apart_V**2)) - noise_floor(voltage_V).variance
    return np.concatenate([between_V[:1], between_V]), max(square_V2, 0.0) ** 0.5
