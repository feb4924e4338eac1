"""Departures of a bench, described: how large, what they usually mean, what to do."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from motord.config import MotorConfig
from motord.experiments.calibration.estimate.lack_of_fit.departures import Cause
from motord.experiments.subject import Subject


def fundamental(motor: MotorConfig) -> float:
    """Return the amplitude of the back-EMF's fundamental (V s/rad)."""
    k = motor.back_emf_table()[:, 0]
    return float(2 * abs(np.fft.rfft(k)[motor.pole_pairs]) / k.size)


@dataclass(frozen=True)
class Meaning:
    """How a kind of departure is described: its size in `unit`, what it means, what to do.

    text: with `{size}` and `{order}`.
    """

    unit: str
    size: Callable[[Cause, Subject], float]
    text: str
    action: str


def _percent(cause: Cause, _: Subject) -> float:
    return 100 * float(np.linalg.norm(cause.size[:2]))


def _largest_percent(cause: Cause, _: Subject) -> float:
    return 100 * float(np.abs(cause.size).max())


def _degrees(cause: Cause, _: Subject) -> float:
    return float(np.degrees(np.linalg.norm(cause.size)))


def _microseconds(cause: Cause, _: Subject) -> float:
    return 1e6 * float(cause.size[0])


def _twice_degrees(cause: Cause, bench: Subject) -> float:
    return 2 * _degrees(cause, bench)


def _percent_at_rated(cause: Cause, bench: Subject) -> float:
    return 100 * bench.motor.rated_current_A() * abs(float(cause.size[0]))


def _curve_percent(cause: Cause, bench: Subject) -> float:
    """Return the largest change of a phase's gain between no current and the rated one."""
    i_A = bench.motor.rated_current_A()
    linear, square = cause.size[:3] * i_A, cause.size[3:] * i_A**2
    return 100 * float(np.abs([linear + square, linear - square]).max())


def _of_fundamental(cause: Cause, bench: Subject) -> float:
    return 100 * float(np.linalg.norm(cause.size)) / fundamental(bench.motor)


def _of_rated_torque(cause: Cause, bench: Subject) -> float:
    return 100 * float(np.linalg.norm(cause.size)) / bench.motor.rated_torque_Nm


def _corner_percent(cause: Cause, bench: Subject) -> float:
    """Return by how much the corner frequency differs from what the bench file says.

    Where it says that there is none, of 1 rad/s.
    """
    return 100 * abs(float(cause.size[0])) * (bench.sensor.highpass_time_constant_s or 1.0)


def fitted_time_constant_s(cause: Cause, bench: Subject) -> float:
    """Return the time constant of the torque sensor's high-pass that fits; inf for none (s)."""
    stated_s = bench.sensor.highpass_time_constant_s
    rate = float(cause.size[0]) + (1 / stated_s if stated_s else 0.0)
    return 1 / rate if rate > 0 else float("inf")


_CENTRE = "centre the encoder on the shaft, align it and calibrate again"
MEANINGS = {
    "encoder-zero": Meaning(
        "deg", _degrees,
        "the encoder's zero is off by {size} deg (mechanical)",
        "align it with `motord plan start align`",
    ),
    "encoder-error-order-1": Meaning(
        "deg", _degrees, "the encoder is eccentric: it is off by {size} deg once a turn", _CENTRE
    ),
    "encoder-error-order-2": Meaning(
        "deg", _degrees,
        "the encoder is off by {size} deg twice a turn: an oval or tilted disc",
        _CENTRE,
    ),
    "encoder-error": Meaning(
        "deg", _degrees, "the encoder is off by {size} deg {order} times a turn", _CENTRE
    ),
    "backlash": Meaning(
        "deg", _twice_degrees,
        "the encoder's angle differs by {size} deg between the directions: backlash or wind-up of "
        "its coupling, or hysteresis of the cogging torque",
        "tighten or replace the coupling of the encoder and calibrate again",
    ),
    "torque-age": Meaning(
        "us", _microseconds,
        "the torque is {size} us older than angle and currents of the same tick: a low-pass or "
        "averaging of its channel, an anti-aliasing filter, or a bridge that samples it at another "
        "time",
        "sample torque and encoder at the same time, or raise the corner of the filter",
    ),
    "highpass-time-constant": Meaning(
        "% of the corner frequency", _corner_percent,
        "low orders are turned as by a high-pass of the torque sensor whose time constant is "
        "{fitted_s} s, where [torque_sensor] highpass_time_constant_s says {stated_s} s",
        "measure the charge amplifier's time constant (after a step of torque its output falls to "
        "37 % in that time), correct it and analyse again",
    ),
    "back-emf": Meaning(
        "% of the fundamental", _of_fundamental,
        "the back-EMF has another harmonic of electrical order {order} than [motor] back_emf says, "
        "by {size} % of the fundamental",
        "measure the back-EMF with `motord plan start back-emf` and analyse again with its file",
    ),
    "torque-sensor-crosstalk": Meaning(
        "%", _percent,
        "the torque sensor reads {size} % more and less with the angle, {order} times a turn: "
        "cross-talk of side forces, or a motor that is not centred on it",
        "turn the sensor under the motor and calibrate again: what turns with it is its own",
    ),
    "current-sensor-crosstalk": Meaning(
        "%", _largest_percent,
        "current sensors read up to {size} % of other phases' currents",
        "lay the phase leads apart from the other sensors, or calibrate each sensor with current "
        "in one phase at a time",
    ),
    "current-sensor-nonlinearity": Meaning(
        "%", _curve_percent,
        "gains of current sensors change by up to {size} % between no current and the rated one",
        "calibrate the sensors against a shunt over their range; learning takes out the residual",
    ),
    "back-emf-load": Meaning(
        "% at rated current", _percent_at_rated,
        "torque falls behind the current by {size} % at rated current: saturation, or warm magnets",
        "calibrate over the torques that are used; learning takes out the residual",
    ),
    "cogging-load": Meaning(
        "% at rated current", _percent_at_rated,
        "cogging torque changes with the current, by {size} % at rated current: saturation",
        "calibrate over the torques that are used; learning takes out the residual",
    ),
    "friction-ripple": Meaning(
        "% of rated", _of_rated_torque,
        "friction ripples by {size} % of rated torque {order} times a turn: it changes its sign "
        "with the direction, as cogging torque does not",
        "look after bearings and couplings; what is compensated holds for one direction only",
    ),
}  # fmt: skip
