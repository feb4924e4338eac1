"""What currents and torque should be, compared with what is measured: compiled."""

import math

import numpy as np

from motord.config.timing import POSITION_AGE_MAX_S, TORQUE_SHARE
from motord.control.park import turned
from motord.jit import jit

CUT_MEMORY_S = 1.0
"""After this time 1/e is left of the torque that limited currents lacked: sensors are not quick."""


@jit
def compare_currents(
    p: np.record, m: np.record, f: np.record, all_of_them: bool
) -> tuple[bool, bool]:
    """Return (whether the sensed currents fit a command, whether they are beyond another's limit).

    They are compared with the commands that can have been in force when they were measured: of
    those sent by then the last ones, back to the newest that has had time to settle; two at least,
    because a frame may be lost or late. A current that has not settled may be anywhere on the
    straight line between two commands. A drive that turns its set-point with the rotor has turned
    each command since its current began to flow. Nothing can be said, neither of both, of currents
    that were measured before the oldest command that is remembered, or that are not finite.
    all_of_them: False where the first that fits is enough, which takes much less time.
    """
    fits = beyond = False
    if not math.isfinite(f.i_A[0] + f.i_A[1] + f.i_A[2]):
        return fits, beyond
    later, settled, before = _sent_after(p, m, f.t_inverter_ns), True, (0.0, 0.0, 0.0)
    for back in range(later, m.commands):
        place = _place(p, m, back)
        apart = _deviation(p, m, f, place)
        on = max(abs(apart[0]), abs(apart[1]), abs(apart[2])) <= p.current_error_A
        fits = fits or on or (not settled and _passes(p.current_error_A, before, apart))
        beyond = beyond or not on
        settled, before = f.t_inverter_ns - m.command_ns[place] >= p.settling_ns, apart
        if (fits and (beyond or not all_of_them)) or (settled and back > later):
            break
    return fits, beyond


@jit
def _sent_after(p: np.record, m: np.record, t_ns: int) -> int:
    """Return how many of the remembered commands are of ticks that began after `t_ns`."""
    low, high = 0, m.commands
    while low < high:
        middle = (low + high) // 2
        if m.command_ns[_place(p, m, middle)] > t_ns:
            low = middle + 1
        else:
            high = middle
    return int(low)


@jit
def _place(p: np.record, m: np.record, back: int) -> int:
    """Return where in the ring the command is that came `back` before the newest."""
    place = m.newest - back
    return int(place if place >= 0 else place + p.commands)


@jit
def _deviation(p: np.record, m: np.record, f: np.record, place: int) -> tuple[float, float, float]:
    """Return the sensed currents less the command at a place of the ring (A).

    In a star the zero sequence is no part of a command.
    """
    of_a, of_b, of_c = m.command_A[place, 0], m.command_A[place, 1], m.command_A[place, 2]
    if p.turning:
        flowing_s = 1e-9 * (f.t_inverter_ns - m.command_ns[place]) - p.actuation_delay_s
        turned_rad = p.pole_pairs * m.speed_rad_s * flowing_s
        of_a, of_b, of_c = turned(turned_rad, p.axes_sequence, of_a, of_b, of_c)
    a, b, c = float(f.i_A[0] - of_a), float(f.i_A[1] - of_b), float(f.i_A[2] - of_c)
    mean = (a + b + c) / 3.0 if p.star else 0.0
    return a - mean, b - mean, c - mean


@jit
def _passes(limit: float, first: tuple[float, ...], second: tuple[float, ...]) -> bool:
    """Return whether a point of the line from `first` to `second` has no part beyond `limit`."""
    low, high = 0.0, 1.0
    for phase in range(3):
        change = second[phase] - first[phase]
        if change == 0.0:
            if abs(first[phase]) > limit:
                return False
            continue
        one, other = (-limit - first[phase]) / change, (limit - first[phase]) / change
        low, high = max(low, min(one, other)), min(high, max(one, other))
    return low <= high


@jit
def remember_command(p: np.record, m: np.record, s: np.record, i_A: np.ndarray) -> None:
    """Keep the command of this tick, its torque, and by how much this may be another.

    A gain that is induced in all phases is part of what was asked for. The torque of an offset that
    is induced depends on the rotor's angle, which may not be known yet: the most of it is kept.
    Errors that are no numbers let no current flow: kept is what was asked for without them.
    """
    gain = 1.0 + (s.induced_gain[0] + s.induced_gain[1] + s.induced_gain[2]) / 3.0
    offset = s.induced_offset_A
    induced_Nm = p.torque_per_A * (abs(offset[0]) + abs(offset[1]) + abs(offset[2]))
    if not math.isfinite(gain + induced_Nm):
        gain, induced_Nm = 1.0, 0.0
    m.torque_asked_Nm = gain * m.torque_set_Nm
    m.deviation_Nm = induced_Nm + m.torque_cut_Nm
    m.torque_cut_Nm *= max(1.0 - p.period_s / CUT_MEMORY_S, 0.0)
    place = m.newest + 1 if m.newest + 1 < p.commands else 0
    m.newest = place
    m.commands = min(m.commands + 1, p.commands)
    m.command_ns[place] = m.now_ns
    for phase in range(3):
        m.command_A[place, phase] = i_A[phase]


@jit
def _lacked_standing_Nm(p: np.record, m: np.record, missed: int) -> float:
    """Return the most torque that the currents lacked, which stood still in `missed` ticks.

    Where the rotor has turned by an electrical angle d, T cos(d) is left of the torque T. Of d
    nothing is known after POSITION_AGE_MAX_S.
    """
    stood_s = missed * p.period_s
    turned_rad = p.pole_pairs * abs(m.speed_rad_s) * stood_s
    if stood_s > POSITION_AGE_MAX_S or turned_rad > math.pi:
        turned_rad = math.pi
    return float((1.0 - math.cos(turned_rad)) * abs(m.torque_asked_Nm))


@jit
def torque_error(p: np.record, m: np.record, torque_Nm: float, missed: int) -> float:
    """Return by how much (Nm) the measured torque is further from the set-point than it may be.

    That is its share, and what induced offsets add and limited currents take away at most. Both of
    the tick before go through the sensor's high-pass: what |x| <= A leaves is within A plus the
    mean that was taken for A. Call once a tick; missed: ticks that the loop has missed since the
    tick before, while the currents stood still and the rotor turned on.
    """
    if missed > 0:
        m.deviation_Nm = max(m.deviation_Nm, _lacked_standing_Nm(p, m, missed))
    decay = p.torque_decay if missed == 0 else p.torque_decay ** (1 + missed)
    m.torque_expected_Nm = decay * (m.torque_expected_Nm + m.torque_asked_Nm - m.torque_before_Nm)
    m.torque_before_Nm = m.torque_asked_Nm
    m.deviation_mean_Nm += (1.0 - decay) * (m.deviation_Nm - m.deviation_mean_Nm)
    apart_Nm = abs(torque_Nm - float(m["torque_expected_Nm"]))
    may_Nm = TORQUE_SHARE * abs(m.torque_asked_Nm) + m.deviation_Nm + m.deviation_mean_Nm
    excess_Nm = float(apart_Nm - may_Nm)
    return excess_Nm if math.isfinite(apart_Nm) else 0.0
