"""How torque and speed followed a profile, and the mechanical energy, from the ticks of its cycles.

A torque sensor that does not pass the mean, but H = s tau / (1 + s tau), shows the fast part of the
torque, and drifts. The slow part is that of the currents, T_i = sum_p (alpha_p i_p + beta_p) k_p
plus the cogging torque. Complementary, with another H against the drift:

    T = H T_sensor + (1 - H^2) T_i

The energy is the integral of T over the encoder's angle: the estimated speed lacks fast ripple. The
RMS of the torque's error is without the white noise that is in T.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import hypot, sqrt
from typing import Any

import numpy as np

from motord.calibration import Calibration
from motord.experiments.captures_left_out import CapturesLeftOut
from motord.experiments.profile import NAME, ProfileConfig
from motord.experiments.profile.cycle_torque import slow_square, torques
from motord.experiments.profile.findings import CycleSignals, findings
from motord.experiments.profile.result import (
    Cycle,
    CycleSeries,
    ProfileTracking,
    Spans,
    TorqueMoments,
    TrackingError,
)
from motord.experiments.subject import (
    AnalysisError,
    Recordings,
    Subject,
    check_plan,
    recorded_settings,
    require_columns,
)
from motord.identification import CaptureError
from motord.identification.disturbances.noise_floor import noise_floor
from motord.identification.operating_points import COMMANDS, CURRENTS, good_points
from motord.identification.signal_condition import require_change, sound_counts
from motord.identification.turning import countable, unwrap_counts
from motord.recording.reader import Run, bounds_of
from motord.schema import rows_of
from motord.uncertainty_budget import totals

COLUMNS = (
    *("t_ns", "encoder_count", *CURRENTS, "torque_Nm", "torque_set_Nm", "speed_rad_s"),
    *("speed_set_rad_s", "setpoint_seq", "plan_point"),
)

BEFORE_TIME_CONSTANTS = 5.0
"""Time before a cycle from which on its torque is followed, in time constants of the sensor."""

ABSENT_MAX_S = 0.5
"""Longest time without ticks in a cycle: nothing shows what the bench did meanwhile."""

SPANS = 400
"""Spans of a cycle in pictures, at most."""


@dataclass(frozen=True)
class _Signals:
    """A cycle over time, n samples: t_s of the profile, what was asked for, what was measured.

    angle_rad: not wrapped. drift_Nm2: mean square of what the sensor adds slowly to the currents.
    """

    t_s: np.ndarray
    speed_wanted_Hz: np.ndarray
    speed_Hz: np.ndarray
    torque_wanted_Nm: np.ndarray
    torque_Nm: np.ndarray
    angle_rad: np.ndarray
    drift_Nm2: float = 0.0


def measure(recordings: Recordings, calibration: Calibration | None) -> ProfileTracking:
    """Return how the profile of the recordings was followed.

    calibration: the one in force, for gains and offsets of the currents. Raises AnalysisError.
    """
    runs, subject = recordings.runs, recordings.subject
    for run in runs:
        check_plan(run, NAME)
    settings = [recorded_settings(run, ProfileConfig) for run in runs]
    profiles = [(one.sha256, one.torque_factor, one.speed_factor) for one in settings]
    for run, profile in zip(runs, profiles, strict=True):
        if profile != profiles[0]:
            raise AnalysisError(
                f"{run.path}: is of another profile than {runs[0].path}, or has other factors of "
                "torque and speed; analyse them one by one"
            )
    own = settings[0]
    left_out = CapturesLeftOut()
    found = [one for run in runs for one in _cycles(run, subject, own, calibration, left_out)]
    if not found:
        files = ", ".join(str(run.path) for run in runs)
        raise AnalysisError(
            f"{files}: no cycle of good quality in there; play the profile again{left_out.as_text}"
        )
    return ProfileTracking(
        own.file,
        own.sha256,
        own.speed_tolerance_Hz,
        own.torque_tolerance_Nm,
        _scale_uncertainty(subject, calibration),
        _source(subject, calibration),
        tuple(cycle for cycle, _ in found),
        (
            *findings([signals for _, signals in found], subject),
            *left_out.findings(runs),
        ),
        subject.accuracy.torque_zero_Nm / sqrt(3) if subject.sensor.passes_mean else 0.0,
    )


def _scale_uncertainty(subject: Subject, calibration: Calibration | None) -> float | None:
    """Return the standard uncertainty of the torque's scale, in parts (Type B); None: unknown."""
    accuracy = subject.accuracy
    if subject.sensor.passes_mean:
        return accuracy.torque_scale
    if calibration is None:
        return None
    if calibration.budget:
        return totals(calibration.budget)[2].delta_epsilon / calibration.delta_epsilon
    return hypot(accuracy.current_gain_percent, accuracy.back_emf_percent) / 100 / sqrt(3)


def _source(subject: Subject, calibration: Calibration | None) -> str:
    tau_s = subject.sensor.highpass_time_constant_s
    if tau_s == 0:
        return "as the sensor measures it"
    gains = (
        f"with calibration {calibration.id}"
        if calibration
        else "whose gains and offsets are not known, so that energy, power, mean torque and torque "
        "error have no interval: name the calibration with --calibration"
    )
    return (
        f"as the sensor measures it above {1 / (2 * np.pi * tau_s):.2g} Hz; below that, which it "
        f"does not pass, from the currents, {gains}"
    )


def _cycles(
    run: Run,
    subject: Subject,
    own: ProfileConfig,
    calibration: Calibration | None,
    left_out: CapturesLeftOut,
) -> Iterator[tuple[Cycle, CycleSignals]]:
    require_columns(run, COLUMNS)
    for point in good_points(run.operating_points()):
        index = int(point["index"])
        with left_out.noted(f"{run.path.name}: cycle {index + 1}", (run.path, index)):
            signals, checked = _signals(run, point, subject, calibration)
            wanted = signals.speed_wanted_Hz, signals.torque_wanted_Nm
            if not np.isfinite([*wanted, signals.speed_Hz, signals.torque_Nm]).all():
                raise CaptureError("ticks without torque, speed, currents or set-points")
            cycle = _cycle(signals, index, run.path.name, own)
            yield cycle, checked


def _signals(
    run: Run, point: Mapping[str, Any], subject: Subject, calibration: Calibration | None
) -> tuple[_Signals, CycleSignals]:
    """Return a cycle over the profile's time, and its signals to be checked."""
    tau_s, bounds = subject.sensor.highpass_time_constant_s, bounds_of(point)
    begins_ns = bounds["from_ns"]
    bounds["from_ns"] -= round(BEFORE_TIME_CONSTANTS * tau_s * 1e9)
    commands = COMMANDS if set(COMMANDS) <= set(run.columns) else ()
    ticks = run.ticks((*COLUMNS, *commands), **bounds)
    name = f"cycle {int(point['index']) + 1}"
    count = ticks["encoder_count"].astype(np.int64)
    label = f"{run.path.name}: {name}"
    readable, of_encoder = sound_counts(count, subject.motor.counts, label)
    ticks = rows_of(ticks, readable)
    captured = ticks["plan_point"] == int(point["index"])
    captured &= ticks["t_ns"] >= begins_ns  # before may be an earlier take of the same cycle
    torque_Nm, passed_Nm, currents_Nm = torques(ticks, subject, calibration)[:, captured]
    ticks = rows_of(ticks, captured)
    apart_ns = np.diff(ticks["t_ns"], prepend=begins_ns, append=bounds["to_ns"])
    if (absent_s := 1e-9 * float(apart_ns.max())) > ABSENT_MAX_S:
        raise CaptureError(f"{label}: {absent_s:.3g} s of it without ticks; play it again")
    require_change({"torque_Nm": ticks["torque_Nm"]}, label)
    checked = CycleSignals.of(name, ticks, passed_Nm, currents_Nm, subject.motor)
    checked = replace(checked, faults=(*checked.faults, *of_encoder))
    at_s = (ticks["t_ns"] - ticks["t_ns"][0]) * 1e-9
    count = ticks["encoder_count"].astype(np.int64)
    countable(at_s, count, subject.motor.counts, label)  # next to the time before, few are misread
    speed_wanted, torque_wanted_Nm = _asked_for(at_s, ticks)
    signals = _Signals(
        at_s + float(point.get("profile_start_s", 0.0)),
        speed_wanted / (2 * np.pi),
        ticks["speed_rad_s"].astype(float) / (2 * np.pi),
        torque_wanted_Nm,
        torque_Nm,
        2 * np.pi / subject.motor.counts * unwrap_counts(count, subject.motor.counts),
        slow_square(at_s, torque_Nm - currents_Nm, tau_s / 4) if tau_s else 0.0,
    )
    return signals, checked


def _asked_for(t_s: np.ndarray, ticks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return speed (rad/s) and torque (Nm) that were asked for at each tick (n,).

    Each set-point is that of the middle of its time, and the torque's ramp is at it by the end.
    """
    starts = np.flatnonzero(np.diff(ticks["setpoint_seq"].astype(np.int64), prepend=-1))
    ends = np.append(starts[1:], t_s.size) - 1
    middle_s = 0.5 * (t_s[starts] + t_s[ends])
    return (
        np.interp(t_s, middle_s, ticks["speed_set_rad_s"][ends].astype(float)),
        np.interp(t_s, middle_s, ticks["torque_set_Nm"][ends].astype(float)),
    )


def _cycle(signals: _Signals, index: int, run: str, own: ProfileConfig) -> Cycle:
    t_s, torque_Nm = signals.t_s, signals.torque_Nm
    error_Nm = torque_Nm - signals.torque_wanted_Nm
    moments = _moments(torque_Nm, error_Nm, signals.drift_Nm2)
    work_J = 0.5 * (torque_Nm[1:] + torque_Nm[:-1]) * np.diff(signals.angle_rad)
    wanted_W = 2 * np.pi * signals.torque_wanted_Nm * signals.speed_wanted_Hz
    duration_s = float(t_s[-1] - t_s[0])
    turns = float(signals.angle_rad[-1] - signals.angle_rad[0]) / (2 * np.pi)
    return Cycle(
        index + 1,
        run,
        duration_s,
        _tracking(t_s, signals.speed_Hz - signals.speed_wanted_Hz, own.speed_tolerance_Hz),
        replace(_tracking(t_s, error_Nm, own.torque_tolerance_Nm), rms=moments.rms_Nm),
        moments,
        energy_J=float(work_J.sum()),
        absorbed_J=float(-np.minimum(work_J, 0.0).sum()),
        energy_wanted_J=float(np.trapezoid(wanted_W, t_s)),
        torque_mean_Nm=float(np.trapezoid(torque_Nm, t_s)) / duration_s,
        speed_mean_Hz=turns / duration_s,
        turns=turns,
        series=_series(signals),
    )


def _tracking(t_s: np.ndarray, error: np.ndarray, tolerance: float) -> TrackingError:
    worst = int(np.argmax(np.abs(error)))
    return TrackingError(
        float(np.sqrt(np.mean(error**2))),
        float(abs(error[worst])),
        float(t_s[worst]),
        100 * float(np.mean(np.abs(error) <= tolerance)),
    )


def _moments(torque_Nm: np.ndarray, error_Nm: np.ndarray, drift_Nm2: float) -> TorqueMoments:
    return TorqueMoments(
        torque_Nm2=float(np.mean(torque_Nm**2)),
        error_Nm=float(np.mean(error_Nm)),
        error_torque_Nm2=float(np.mean(error_Nm * torque_Nm)),
        square_Nm2=float(np.mean(error_Nm**2)),
        noise=noise_floor(error_Nm),
        drift_Nm2=drift_Nm2,
    )


def _series(signals: _Signals) -> CycleSeries:
    edges = np.unique(np.linspace(0, signals.t_s.size, SPANS + 1).astype(int))[:-1]
    counts = np.diff(np.append(edges, signals.t_s.size))

    def means(values: np.ndarray) -> np.ndarray:
        return np.asarray(np.add.reduceat(values, edges) / counts)

    def spans(wanted: np.ndarray, measured: np.ndarray) -> Spans:
        low, high = (limit.reduceat(measured, edges) for limit in (np.minimum, np.maximum))
        return Spans(means(wanted), means(measured), low, high)

    return CycleSeries(
        means(signals.t_s),
        spans(signals.speed_wanted_Hz, signals.speed_Hz),
        spans(signals.torque_wanted_Nm, signals.torque_Nm),
    )
