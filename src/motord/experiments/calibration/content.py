"""The content of a report: results of estimators in the words of the page."""

from collections.abc import Sequence

import numpy as np

from motord.calibration import Calibration, RmsErrors
from motord.config import MotorConfig
from motord.experiments.calibration.estimate.result import CalibrationResult, rms_errors
from motord.experiments.calibration.report import CalibrationReport, Estimate, Shares, View
from motord.experiments.ripple.reconstruct import Explained
from motord.experiments.subject import Subject
from motord.identification.point_ripple import PointRipple
from motord.identification.ripple import harmonics_table
from motord.report.plots.mesh import Point
from motord.report.plots.torque import Ripple

VIEW_ANGLES = 2048
"""Angles over one turn at which the torque is drawn."""


def estimate_of_result(result: CalibrationResult, label: str) -> Estimate:
    """Return what an estimator found, for the report."""
    return Estimate(
        label=label,
        alpha=result.alpha,
        beta_A=result.beta_A,
        tau_cog_Nm=result.tau_cog_Nm,
        order=np.array([h.order for h in result.harmonics], int),
        amplitude_Nm=np.array([h.amplitude_Nm for h in result.harmonics]),
        alpha_stderr=result.alpha_stderr,
        beta_stderr_A=result.beta_stderr_A,
        amplitude_stderr_Nm=np.array([h.stderr_Nm for h in result.harmonics]),
    )


def estimate_of_calibration(calibration: Calibration, label: str) -> Estimate:
    """Return what a calibration file says, for the report."""
    harmonics = calibration.tau_cog_harmonics
    return Estimate(
        label=label,
        alpha=np.array(calibration.alpha),
        beta_A=np.array(calibration.beta_A),
        tau_cog_Nm=np.array(calibration.tau_cog_Nm),
        order=np.array([h.order for h in harmonics], int),
        amplitude_Nm=np.array([h.amplitude_Nm for h in harmonics]),
        alpha_stderr=np.array(calibration.alpha_stderr),
        beta_stderr_A=np.array(calibration.beta_stderr_A),
        amplitude_stderr_Nm=np.array([h.stderr_Nm for h in harmonics]),
    )


def estimate_of_truth(
    alpha: Sequence[float],
    beta_A: Sequence[float],
    cogging: Sequence[tuple[int, float, float]],
    counts: int,
) -> Estimate:
    """Return what is true of a simulated rig. cogging: (order, amplitude_Nm, phase_rad) each."""
    order = np.array([h[0] for h in cogging], int)
    amplitude_Nm = np.array([h[1] for h in cogging])
    phase_rad = np.array([h[2] for h in cogging])
    return Estimate(
        label="truth",
        alpha=np.array(alpha),
        beta_A=np.array(beta_A),
        tau_cog_Nm=harmonics_table(order, amplitude_Nm, phase_rad, counts),
        order=order,
        amplitude_Nm=np.abs(amplitude_Nm),
    )


def split_errors(errors: RmsErrors) -> tuple[dict[Point, float], dict[Point, float]]:
    """Return RMS errors before and after by (torque_Nm, speed_Hz)."""
    before = {(p.torque_Nm, p.speed_Hz): p.before for p in errors.points if p.before is not None}
    after = {(p.torque_Nm, p.speed_Hz): p.after for p in errors.points if p.after is not None}
    return before, after


def view(points: Sequence[PointRipple], motor: MotorConfig) -> View | None:
    """Return the torque before and after at the point in the middle of the mesh."""
    before = {(p.torque_Nm, p.speed_Hz): p for p in points if p.compensate == 0}
    after = {(p.torque_Nm, p.speed_Hz): p for p in points if p.compensate != 0}
    places = sorted(before.keys() & after.keys() or before.keys() | after.keys())
    if not places:
        return None
    place = _middle(places)
    return View(
        label=f"{place[0]:g} Nm, {place[1]:g} turns/s",
        before=_drawn(before[place]) if place in before else None,
        after=_drawn(after[place]) if place in after else None,
        marked_orders=tuple(range(motor.pole_pairs, 40 * motor.pole_pairs, motor.pole_pairs)),
    )


def _middle(places: Sequence[Point]) -> Point:
    """Return a point that was taken, near the middle torque and the middle speed."""
    torques_Nm = sorted({torque_Nm for torque_Nm, _ in places})
    torque_Nm = torques_Nm[len(torques_Nm) // 2]
    speeds_Hz = sorted(speed_Hz for torque, speed_Hz in places if torque == torque_Nm)
    return torque_Nm, speeds_Hz[(len(speeds_Hz) - 1) // 2]


def _drawn(point: PointRipple) -> Ripple:
    angle_rad = np.linspace(0, 2 * np.pi, VIEW_ANGLES + 1)
    return Ripple(
        angle_rad=angle_rad,
        torque_Nm=point.torque_over(angle_rad),
        order=point.order,
        amplitude_Nm=np.abs(point.line_Nm),
        noise_Nm=point.noise_Nm,
    )


def facts(
    calibration: Calibration | None, subject: Subject, runs: Sequence[str]
) -> tuple[tuple[str, str], ...]:
    """Return rows about bench, motor, runs and calibration."""
    motor = subject.motor
    serial = f", serial {motor.serial}" if motor.serial else ""
    rows = [
        ("bench", subject.bench),
        (
            "motor",
            f"{motor.name}{serial}: {motor.slots} slots, {2 * motor.pole_pairs} poles, "
            f"{motor.counts} counts, {motor.rated_torque_Nm:g} Nm rated, {motor.connection}",
        ),
        ("recordings", ", ".join(runs)),
    ]
    if calibration is not None:
        c = calibration
        rows += [
            ("calibration", f"{c.id}, made {c.created:%Y-%m-%d %H:%M} UTC"),
            ("method", f"{c.method}, condition number {c.condition_number:.3g}"),
            ("delta epsilon", f"{c.delta_epsilon:.4f} ({c.delta_epsilon_source})"),
        ]
    return tuple(rows)


def shares_of(points: Sequence[Explained]) -> Shares | None:
    """Return measured ripple, that from the currents, and the rest; None without points.

    Where there are points with compensation, of those alone.
    """
    compensated = [p for p in points if p.measured.compensate]
    points = compensated or points
    if not points:
        return None
    at = [(p.measured.torque_Nm, p.measured.speed_Hz) for p in points]
    return Shares(
        measured=dict(zip(at, (p.measured.rms_percent for p in points), strict=True)),
        reconstructed=dict(zip(at, (p.reconstructed.rms_percent for p in points), strict=True)),
        rest=dict(zip(at, (p.rest_percent for p in points), strict=True)),
    )


MEASURED = "measured torque, freed of noise and of the sensor's response"
"""Which torque the RMS errors of a report are of, unless it says otherwise."""


def calibration_report(
    subject: Subject,
    runs: Sequence[str],
    calibration: Calibration | None,
    points: Sequence[PointRipple],
    estimates: Sequence[Estimate] = (),
    reference: Estimate | None = None,
    *,
    title: str = "Calibration of torque ripple",
    torque_meaning: str = MEASURED,
    errors: RmsErrors | None = None,
    shares: Shares | None = None,
) -> CalibrationReport:
    """Return the content of a report.

    runs: names of the recordings. points: measured ripples, of which the torque at one operating
    point is drawn. errors: RMS errors to show, by default those of `points`.
    """
    before, after = split_errors(rms_errors(points) if errors is None else errors)
    return CalibrationReport(
        title=title,
        lead=f"{subject.motor.name} on bench {subject.bench}",
        facts=facts(calibration, subject, runs),
        torque_meaning=torque_meaning,
        before=before,
        after=after,
        view=view(points, subject.motor),
        shares=shares,
        estimates=tuple(estimates),
        reference=reference,
        observable=calibration.observable if calibration is not None else (),
    )
