"""What currents and torque should be, beside what is measured: compiled."""

import math

import numpy as np

from motord.jit import jit

TORQUE_SHARE = 0.2
"""Part of the torque set-point by which the measured torque may be off, besides torque_error_Nm."""


@jit
def current_error(p: np.record, m: np.record, f: np.record) -> float:
    """Return how far (A) the phase furthest from its command is, of the last two commands.

    A command is under way for a while, so the one before it may still be in force. In a star the
    part common to all phases is nobody's command.
    """
    return min(_furthest(p, f.i_A, m.i_last_A), _furthest(p, f.i_A, m.i_before_A))


@jit
def _furthest(p: np.record, i_A: np.ndarray, command_A: np.ndarray) -> float:
    a, b, c = i_A[0] - command_A[0], i_A[1] - command_A[1], i_A[2] - command_A[2]
    if p.star:
        mean = (a + b + c) / 3.0
        a, b, c = a - mean, b - mean, c - mean
    return float(max(abs(a), abs(b), abs(c)))


@jit
def remember_command(m: np.record, s: np.record, i_A: np.ndarray, limited: bool) -> None:
    """Keep the command of this tick, its torque, and whether this had to be less than asked for.

    A gain that is induced in all phases is part of what was asked for.
    """
    gain = 1.0 + (s.induced_gain[0] + s.induced_gain[1] + s.induced_gain[2]) / 3.0
    m.torque_asked_Nm = gain * m.torque_set_Nm
    for phase in range(3):
        m.i_before_A[phase] = m.i_last_A[phase]
        m.i_last_A[phase] = i_A[phase]
    m.limited = 1 if limited else 0


@jit
def torque_error(p: np.record, m: np.record, torque_Nm: float) -> float:
    """Return by how much (Nm) the measured torque is further from the set-point than its share.

    The set-point of the tick before goes through the sensor's high-pass. Call once a tick.
    """
    m.torque_expected_Nm = p.torque_decay * (
        m.torque_expected_Nm + m.torque_asked_Nm - m.torque_before_Nm
    )
    m.torque_before_Nm = m.torque_asked_Nm
    apart_Nm = abs(torque_Nm - float(m["torque_expected_Nm"]))
    return (
        float(apart_Nm - TORQUE_SHARE * abs(m.torque_asked_Nm)) if math.isfinite(apart_Nm) else 0.0
    )
