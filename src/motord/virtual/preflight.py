"""A plan tried out in virtual time before it is run: which points would fail, and why.

The nominal rig is what the bench file says, where no rig file has a truth of its own.
"""

import math
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from motord.calibration import Calibration
from motord.config import BackEmfHarmonic, Config, PhaseOrder
from motord.config.motor import MotorConfig
from motord.config.motor.back_emf import BackEmfTable
from motord.rig.truth import (
    MAX_ORDER,
    MAX_ORDERS,
    BrakeTruth,
    DriveTruth,
    EncoderTruth,
    MotorTruth,
    RigTruth,
    TorqueSensorTruth,
    load,
)
from motord.rig.truth.inverter import DEAD_TIME_MAX_S, InverterTruth
from motord.sequencing import OperatingPoint, Plan
from motord.sequencing.quality import GOOD
from motord.virtual.bench import VirtualBench
from motord.virtual.plan import PlanFailed, run_plan

HARMONICS = range(1, 14, 2)
SMALLEST_PART = 1e-3
"""Harmonics of a measured back-EMF below this part of the first are left out."""
CURRENT_MARGIN = 1.5
RESONANCE_MAX_HZ = 3000.0
BANDWIDTH_MAX_HZ = 5000.0

BY_HAND = frozenset({"inertia-oscillation"})
"""Plans in which an operator has to move the rotor, unless the rig simulates that."""


def nominal_rig(config: Config) -> tuple[Config, RigTruth]:
    """Return the bench to be simulated, without its faults, and the rig for it.

    The rig is that of `[bench] rig`; without one, motor, brake, sensor, encoder and inverter are
    what the bench file says, free of errors, noise and cogging, with the inertia of the packaged
    rig. Raises ConfigError if the rig file cannot be read.
    """
    config = config.model_copy(update={"bench": config.bench.model_copy(update={"faults": None})})
    if config.bench.rig is not None:
        return config, load(config.bench.rig)
    aligned = {"encoder_offset_rad": 0.0, "encoder_direction": 1}  # phase_order: the rig's, too
    config = config.model_copy(update={"motor": config.motor.model_copy(update=aligned)})
    return config, _truth(config)


def _truth(config: Config) -> RigTruth:
    motor, sensor, brake = config.motor, config.torque_sensor, config.brake
    return RigTruth(
        motor=MotorTruth(
            pole_pairs=motor.pole_pairs, connection=motor.connection, back_emf=_harmonics(motor)
        ),
        inverter=_inverter(config),
        brake=BrakeTruth(
            torque_max_Nm=brake.torque_max_Nm,
            critical_speed_rad_s=brake.critical_speed_rad_s,
            excitation_time_constant_s=brake.excitation_time_constant_s,
        ),
        drive=DriveTruth(speed_max_rad_s=config.drive.speed_max_rad_s),
        torque_sensor=TorqueSensorTruth(
            highpass_time_constant_s=sensor.highpass_time_constant_s,
            resonance_Hz=min(sensor.resonance_Hz, RESONANCE_MAX_HZ),
            damping_ratio=sensor.damping_ratio,
            gain_Nm_per_V=sensor.gain_Nm_per_V,
            adc_V_per_count=config.bridge.adc_V_per_count,
        ),
        encoder=EncoderTruth(counts=motor.counts),
    )


def _inverter(config: Config) -> InverterTruth:
    configured, limits = config.inverter, config.limits
    dead_time_s = min(configured.actuation_delay_s - configured.lag_s, DEAD_TIME_MAX_S)
    bandwidth_Hz = 1 / (2 * math.pi * configured.lag_s) if configured.lag_s else BANDWIDTH_MAX_HZ
    return InverterTruth(
        bus_V=(limits.bus_V_min + limits.bus_V_max) / 2,
        dead_time_s=dead_time_s,
        bandwidth_Hz=min(bandwidth_Hz, BANDWIDTH_MAX_HZ),
        phase_order=_phase_order(config.motor),
        current_max_A=CURRENT_MARGIN * limits.trip_current_A,
    )


def _phase_order(motor: MotorConfig) -> PhaseOrder:
    """Return in which order the phases of the motor's back-EMF follow each other."""
    lines = np.fft.rfft(motor.back_emf_table()[:, :2], axis=0)[motor.pole_pairs]
    return "abc" if (lines[1] * lines[0].conj()).imag < 0 else "acb"


def _harmonics(motor: MotorConfig) -> tuple[BackEmfHarmonic, ...]:
    """Return the back-EMF as harmonics: the largest that a rig can have.

    Of a measured table, those of phase a that matter.
    """
    if not isinstance(motor.back_emf, BackEmfTable):
        able = [h for h in motor.back_emf if h.order * motor.pole_pairs <= MAX_ORDER]
        return tuple(sorted(able, key=lambda h: -abs(h.amplitude_V_s_per_rad))[:MAX_ORDERS])
    lines = np.fft.rfft(motor.back_emf.values[:, 0]) * 2 / motor.counts
    orders = [h for h in HARMONICS if h * motor.pole_pairs < min(lines.size, MAX_ORDER)]
    found = {h: complex(lines[h * motor.pole_pairs]) for h in orders}
    return tuple(
        BackEmfHarmonic(
            order=h,
            amplitude_V_s_per_rad=abs(line),
            phase_rad=math.atan2(line.imag, line.real) + math.pi / 2,
        )
        for h, line in found.items()
        if abs(line) >= SMALLEST_PART * abs(found[1])
    )


@dataclass(frozen=True)
class Forecast:
    """What became of a point in the simulation.

    trouble: why it would fail, "" if it would not; quality: of its last take; simulated: False if
    there was no time for it, or if it cannot be, for the reason that trouble then states.
    """

    point: OperatingPoint
    trouble: str = ""
    quality: str = GOOD
    simulated: bool = True

    @property
    def fine(self) -> bool:
        """True if the point was simulated, did not fail and would be good."""
        return self.simulated and not self.trouble and self.quality == GOOD


class _TooLongError(Exception):
    """There is no time left."""


def forecasts(
    config: Config, plan: Plan, calibration: Calibration | None, pool: Executor, limit_s: float
) -> Iterator[Forecast]:
    """Yield what becomes of each point of `plan` on the rig `nominal_rig`, in order.

    Each point is taken on a rig of its own, from standstill, so nothing is said of the moves
    between points. After `limit_s` of elapsed time those that are left are not simulated.
    """
    if plan.name in BY_HAND and nominal_rig(config)[1].swing is None:
        why = "somebody has to move the rotor by hand"
        yield from (Forecast(point, trouble=why, simulated=False) for point in plan.points)
        return
    deadline_s = time.monotonic() + limit_s
    tries = [
        pool.submit(_try, config, plan.part((point,)), calibration, deadline_s)
        for point in plan.points
    ]
    for each in tries:
        yield each.result()


def _try(
    config: Config, part: Plan, calibration: Calibration | None, deadline_s: float
) -> Forecast:
    def keep_time(_ticks: np.ndarray, _truth: np.ndarray) -> None:
        if time.monotonic() > deadline_s:
            raise _TooLongError

    [point] = part.points
    nominal, truth = nominal_rig(config)
    try:
        keep_time(np.empty(0), np.empty(0))
        bench = VirtualBench(nominal, truth, calibration=calibration)
        takes = run_plan(bench, part, keep_time)
    except PlanFailed as failed:
        return Forecast(point, trouble=str(failed).removeprefix(f"{part.name}: "))
    except _TooLongError:
        return Forecast(point, simulated=False)
    return Forecast(point, quality=str(takes[-1].get("quality", GOOD)))
