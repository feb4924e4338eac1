"""What of a trace a bench cannot do, found before anything moves: row, value, limit, what to do."""

import math
import shutil

import numpy as np

from motord.config import Config
from motord.experiments.profile import ProfileConfig
from motord.experiments.profile.course import (
    STEP_S,
    Course,
    brake_load_Nm,
    fastest_rad_s,
    full_torque_Nm,
)
from motord.experiments.profile.trace import Trace
from motord.schema import TICK_DTYPE
from motord.sequencing import PlanError
from motord.sequencing.continuous import fastest_Hz
from motord.sequencing.limits import SPEED_MARGIN, TORQUE_MARGIN, i2t_heat_s

SLACK = 0.02
"""Torque that the brake or the acceleration may lack, in parts of the largest torque: the error in
speed that follows is small, and friction is not known."""

START_ANGLES = 8
"""Angles at which the rotor may stand at the beginning, over half an electrical turn."""

HEAT_STEP_S = 0.005
"""Step of the i2t accumulators."""

PIECE = 10_000
"""Steps of them that are computed at once."""

ROUNDING = 1 + 1e-9

CURRENT_MARGIN = 1.02
COMPENSATED_MARGIN = 1.25
"""Currents that are reckoned with, in parts of those of the torque; the gains by which a
calibration divides them are not known to the plan."""


def check(course: Course, config: Config, own: ProfileConfig, *, compensated: bool) -> None:
    """Refuse a course that the bench cannot play. Raises PlanError."""
    check_limits(course.trace, config)
    check_power(course, own)
    check_authority(course.trace, config, own.inertia_kg_m2)
    check_over_speed(course, config, own.inertia_kg_m2)
    check_over_torque(course, config, own.repeats)
    check_i2t(course, config, own.repeats, COMPENSATED_MARGIN if compensated else CURRENT_MARGIN)


def check_limits(trace: Trace, config: Config) -> None:
    """Refuse torques, speeds and changes of torque beyond the bench's limits. Raises PlanError."""
    limits, fastest = config.limits, fastest_Hz(config)
    torque_Nm, speed_Hz = trace.torque_Nm, trace.speed_Hz
    trace.refuse_first(
        np.abs(torque_Nm) > limits.torque_Nm * ROUNDING,
        lambda row: (
            f"{torque_Nm[row]:g} Nm is above [limits] torque_Nm = {limits.torque_Nm:g}; lower it, "
            "or all torques by torque_factor"
        ),
    )
    trace.refuse_first(
        np.abs(speed_Hz) > fastest * ROUNDING,
        lambda row: (
            f"{speed_Hz[row]:.4g} Hz is above {fastest:.3g} Hz, up to which the brake holds the "
            "rotor safely ([brake] critical_speed_rad_s, [limits] trip_speed_rad_s); lower it, or "
            "all speeds by speed_factor"
        ),
    )
    step_s = np.diff(trace.time_s, prepend=-math.inf)
    change_Nm = np.abs(np.diff(torque_Nm, prepend=torque_Nm[0]))
    rate = limits.torque_rate_Nm_per_s
    trace.refuse_first(
        change_Nm > rate * step_s * ROUNDING,
        lambda row: (
            f"the torque changes by {change_Nm[row]:.4g} Nm within {step_s[row]:.4g} s, faster "
            f"than [limits] torque_rate_Nm_per_s = {rate:g}; give it {change_Nm[row] / rate:.3g} s"
        ),
    )


def check_power(course: Course, own: ProfileConfig) -> None:
    """Refuse more mechanical power than power_max_W. Raises PlanError."""
    if own.power_max_W is None:
        return
    trace = course.trace
    at_s = np.union1d(trace.time_s, course.at_s[course.at_s >= 0])
    torque_Nm, speed_Hz = (
        np.interp(at_s, trace.time_s, v) for v in (trace.torque_Nm, trace.speed_Hz)
    )
    power_W = np.abs(2 * np.pi * torque_Nm * speed_Hz)
    if (over := power_W > own.power_max_W * ROUNDING).any():
        first = int(np.argmax(over))
        raise trace.refused(
            trace.row_at(at_s[first]),
            f"{power_W[first]:.4g} W is above power_max_W = {own.power_max_W:g}; lower torque or "
            "speed there, or by torque_factor or speed_factor",
        )


def check_authority(trace: Trace, config: Config, inertia_kg_m2: float) -> None:
    """Refuse what the brake cannot hold, or no torque of the motor makes. Raises PlanError."""
    rate_Hz_per_s = np.diff(trace.speed_Hz) / np.diff(trace.time_s)
    slack_Nm = SLACK * config.limits.torque_Nm
    for end in (0, 1):
        rows = np.arange(rate_Hz_per_s.size) + end
        torque_Nm, speed_Hz = trace.torque_Nm[rows], trace.speed_Hz[rows]
        turning = np.where(speed_Hz == 0.0, trace.speed_Hz[rows + 1 - 2 * end], speed_Hz)
        load_Nm = brake_load_Nm(torque_Nm, turning, rate_Hz_per_s, inertia_kg_m2)
        most_Nm = full_torque_Nm(config.brake, speed_Hz)
        for wrong, why in (
            (load_Nm > most_Nm + slack_Nm, _too_much),
            (load_Nm < -slack_Nm, _too_little),
        ):
            if wrong.any():
                at = int(np.argmax(wrong))
                words = why(torque_Nm[at], speed_Hz[at], most_Nm[at], load_Nm[at])
                raise trace.refused(int(rows[at]), words)


def _too_much(torque_Nm: float, speed_Hz: float, most_Nm: float, load_Nm: float) -> str:
    return (
        f"the brake holds at most {most_Nm:.3g} Nm at {speed_Hz:.3g} Hz ([brake] torque_max_Nm, "
        f"critical_speed_rad_s), and {load_Nm:.3g} Nm of {torque_Nm:g} are left for it; lower the "
        "torque there, or let it rise after the speed"
    )


def _too_little(torque_Nm: float, speed_Hz: float, most_Nm: float, load_Nm: float) -> str:
    return (
        f"{torque_Nm:g} Nm at {speed_Hz:.3g} Hz lacks {-load_Nm:.3g} Nm for this change of speed "
        "(inertia_kg_m2): the brake drives nothing; give the torque the sign of the speed and let "
        "it be larger, or change the speed more slowly"
    )


def check_over_speed(course: Course, config: Config, inertia_kg_m2: float) -> None:
    """Refuse torque that comes too quickly for the brake, which is slow. Raises PlanError."""
    limit_rad_s = SPEED_MARGIN * config.limits.trip_speed_rad_s
    speed_rad_s = np.abs(fastest_rad_s(course, config.brake, inertia_kg_m2))
    if (over := speed_rad_s > limit_rad_s).any():
        step = int(np.argmax(over))
        raise course.trace.refused(
            course.trace.row_at(float(course.at_s[step])),
            f"the rotor could reach {speed_rad_s[step]:.3g} rad/s at t = {course.at_s[step]:.1f} s "
            f"before the brake holds it, too near to [limits] trip_speed_rad_s = "
            f"{config.limits.trip_speed_rad_s:g} ([brake] excitation_time_constant_s = "
            f"{config.brake.excitation_time_constant_s:g}); let the torque rise more slowly there",
        )


def check_over_torque(course: Course, config: Config, repeats: int) -> None:
    """Refuse torque that the sensor's high-pass shows as too much. Raises PlanError."""
    tau_s, trip_Nm = config.torque_sensor.highpass_time_constant_s, config.limits.trip_torque_Nm
    cycles_Nm = np.tile(course.torque_Nm, min(repeats, 2))
    over = np.abs(high_passed(cycles_Nm, tau_s)) > TORQUE_MARGIN * trip_Nm
    if over.any():
        step = int(np.argmax(over)) % course.at_s.size
        raise course.trace.refused(
            course.trace.row_at(float(course.at_s[step])),
            f"at t = {max(course.at_s[step], 0.0):.1f} s the torque sensor would show more than "
            f"{TORQUE_MARGIN * trip_Nm:.3g} Nm by its high-pass ([torque_sensor] "
            f"highpass_time_constant_s = {tau_s:g}), near [limits] trip_torque_Nm = {trip_Nm:g}; "
            "let the torque change more slowly there, or less",
        )


def high_passed(torque_Nm: np.ndarray, tau_s: float) -> np.ndarray:
    """Return what a high-pass, at rest before, leaves of a torque (n,) that is STEP_S apart.

    Without `identification.basis.highpass`, which would load the compiler where plans are made.
    """
    if not tau_s:
        return torque_Nm
    decay, shown_Nm = math.exp(-STEP_S / tau_s), np.diff(torque_Nm, prepend=0.0)
    for step in range(1, shown_Nm.size):
        shown_Nm[step] += decay * shown_Nm[step - 1]
    return shown_Nm


def check_i2t(course: Course, config: Config, repeats: int, margin: float) -> None:
    """Refuse currents that the i2t interlock would not allow. Raises PlanError."""
    limits = config.limits
    heat_s = np.zeros((START_ANGLES, 3))
    for cycle in range(1, repeats + 1):
        before_s, at_s = heat_s, course.begins_s
        while at_s < course.trace.duration_s:
            ratios = current_ratios(course, config, at_s, margin)
            over, heat_s = heated(ratios, heat_s, limits.i2t_time_s)
            if over is not None:
                at_s += over * HEAT_STEP_S
                raise course.trace.refused(
                    course.trace.row_at(at_s),
                    f"the i2t limit would be reached at t = {max(at_s, 0.0):.1f} s"
                    + f" of cycle {cycle}" * (repeats > 1)
                    + f", by {ratios[over].max() * limits.i2t_current_A:.3g} A in a phase ([limits]"
                    f" i2t_current_A = {limits.i2t_current_A:g}, i2t_time_s = "
                    f"{limits.i2t_time_s:g}); lower the torque before, or by torque_factor",
                )
            at_s += len(ratios) * HEAT_STEP_S
        if (heat_s <= before_s).all():
            return


def current_ratios(course: Course, config: Config, begin_s: float, margin: float) -> np.ndarray:
    """Return phase currents over i2t_current_A, (n, START_ANGLES, 3), every HEAT_STEP_S.

    Those of the programmed reference (Poels 2008, ch. 4) for the torques from begin_s on, times
    `margin`; n is PIECE at most.
    """
    end_s = min(begin_s + PIECE * HEAT_STEP_S, course.trace.duration_s)
    at_s = np.arange(begin_s, end_s, HEAT_STEP_S)[:PIECE]
    torque_Nm = np.interp(at_s, course.at_s, course.torque_Nm)
    angle_rad = np.interp(at_s, course.at_s, course.angle_rad)
    motor = config.motor
    table = motor.back_emf_table()
    if motor.connection == "star":
        table = table - table.mean(axis=1, keepdims=True)
    per_Nm = table / np.maximum((table**2).sum(axis=1, keepdims=True), 1e-12)
    start_rad = np.pi / motor.pole_pairs * np.arange(START_ANGLES) / START_ANGLES
    turned = (angle_rad[:, None] + start_rad) / (2 * np.pi)
    counts = np.floor(turned * motor.counts).astype(np.int64) % motor.counts
    scale = margin / config.limits.i2t_current_A * np.abs(torque_Nm)
    return np.asarray(scale[:, None, None] * np.abs(per_Nm[counts]))


def heated(
    ratios: np.ndarray, before_s: np.ndarray, limit_s: float
) -> tuple[int | None, np.ndarray]:
    """Return the first step (of n) at which an i2t accumulator is above its limit, and its end.

    ratios (n, ...): currents over i2t_current_A; before_s (...): heat before.
    """
    heat_s = i2t_heat_s((ratios**2 - 1.0) * HEAT_STEP_S, before_s)
    over = (heat_s > limit_s).reshape(len(heat_s), -1).any(axis=1)
    return (int(np.argmax(over)) if over.any() else None), heat_s[-1]


def check_room(config: Config, seconds: float) -> None:
    """Refuse what does not fit in one file, or on the disk. Raises PlanError."""
    recording = config.recording
    bytes_needed = seconds * config.loop.rate_Hz * TICK_DTYPE.itemsize
    for needed, limit, name in (
        (seconds, recording.file_max_s, "file_max_s"),
        (bytes_needed / 1e6, recording.file_max_MB, "file_max_MB"),
    ):
        if needed > limit:
            raise PlanError(
                f"profile: {needed:.0f} {name.rpartition('_')[2]} do not fit in one file, "
                f"[recording] {name} = {limit:g}; raise it, or take fewer repeats"
            )
    folder = recording.directory.absolute()
    try:
        while not folder.exists() and folder != folder.parent:
            folder = folder.parent
        free_MB = shutil.disk_usage(folder).free / 1e6 - recording.free_min_MB
    except OSError:
        return  # whether it can be recorded at all is found when it starts
    if bytes_needed / 1e6 > free_MB:
        raise PlanError(
            f"profile: its recording may take {bytes_needed / 1e6:.0f} MB, and {folder} has "
            f"{max(free_MB, 0.0):.0f} MB beyond [recording] free_min_MB; make room"
        )
