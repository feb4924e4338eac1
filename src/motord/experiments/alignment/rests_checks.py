"""What the stops of a current vector show besides the zero: pole pairs, sensors, torque's sign."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from motord.experiments.alignment.rests import PHASE_LAGS_RAD, Rests, unwrapped_rad
from motord.identification import IdentifyError
from motord.schema import rows_of

STOPS_MIN = 10
"""Stops in each direction of the vector that a fit needs."""

SAME_RAD = 0.02
"""Electrical angle within which two stops are at the same place of the electrical turn."""

SLIP_PART = 0.25
"""Standard deviation of the rotor's angle for an electrical turn, in parts of it, of a rotor that
follows the vector."""

DEAD_GAIN = 0.3
"""Part of the commanded current below which a phase does not follow its command."""

HALF_S = 0.015
"""Half the time over which acceleration is taken: a second difference of the encoder's angle."""

EXPLAINED_MIN = 0.1
"""Part of the measured torque's variance that the rotor's motion explains, where the sensor works;
and twice as much as it would with the opposite sign."""


def check_rests(rests: Rests) -> None:
    """Raise IdentifyError if there are too few stops, or the rotor does not rest at them."""
    for sign, direction in ((1, "forwards"), (-1, "backwards")):
        of_direction = rests.direction == sign
        stops, still = int(of_direction.sum()), int((of_direction & rests.still).sum())
        if stops < STOPS_MIN:
            raise IdentifyError(
                f"{stops} stops of a current vector {direction}, at least {STOPS_MIN} are "
                "needed: is this a whole recording of the plan align?"
            )
        if still < STOPS_MIN:
            raise IdentifyError(
                f"the rotor came to rest at {still} of {stops} stops {direction}: set a longer "
                "hold_s, or more brake, which damps its oscillation"
            )


def electrical_turn(rests: Rests) -> tuple[float, float]:
    """Return how far the rotor turns in an electrical turn of the vector, and its standard error.

    In rad, negative if the encoder counts down while the vector turns in the order a, b, c.
    Friction and cogging act alike a whole electrical turn apart, so these pairs of stops are
    compared. Raises IdentifyError if the rotor does not follow.
    """
    rotor_turns_rad = np.concatenate(
        [_rotor_turns(rests, number) for number in np.unique(rests.sweep)]
    )
    if rotor_turns_rad.size < 2:
        raise IdentifyError(
            "there are no two stops a whole electrical turn apart: is this a whole recording of "
            "the plan align?"
        )
    mean_rad, spread_rad = float(rotor_turns_rad.mean()), float(rotor_turns_rad.std(ddof=1))
    if spread_rad >= SLIP_PART * abs(mean_rad):  # both are 0 where it stands
        raise IdentifyError(
            "the rotor does not follow the current vector evenly: is it free, and is the current "
            "enough for friction and cogging torque (currents_A)?"
        )
    return mean_rad, spread_rad / float(np.sqrt(rotor_turns_rad.size))


def _rotor_turns(rests: Rests, number: int) -> np.ndarray:
    own = rests[rests.sweep == number]
    difference_rad = own.electrical_rad[np.newaxis, :] - own.electrical_rad[:, np.newaxis]
    first, second = np.nonzero(np.abs(difference_rad - 2 * np.pi) < SAME_RAD)
    return np.asarray(own.encoder_rad[second] - own.encoder_rad[first])


def check_pole_pairs(turn_rad: float, stderr_rad: float, pole_pairs: int) -> float:
    """Return the pole pairs that fit. Raises IdentifyError if they are others."""
    found = 2 * np.pi / abs(turn_rad)
    if round(found) != pole_pairs:
        raise IdentifyError(
            f"the rotor turned 1/{found:.2f} of a turn for each turn of the current vector: that "
            f"is {round(found)} pole pairs, and [motor] pole_pairs = {pole_pairs}. Correct it; if "
            "it is right, [motor] counts or the encoder's wiring is not"
        )
    if abs(found - pole_pairs) > max(0.15, 5 * stderr_rad / abs(turn_rad) * pole_pairs):
        raise IdentifyError(
            f"the rotor turned 1/{found:.2f} of a turn for each turn of the current vector, which "
            f"is no whole number of pole pairs ([motor] pole_pairs = {pole_pairs}): are [motor] "
            "counts right, and all lines of the encoder connected?"
        )
    return float(found)


def current_gains(rests: Rests) -> tuple[float, float, float]:
    """Return the sensed in parts of the commanded current of each phase.

    Raises IdentifyError where a phase's sensed current does not follow its own command.
    """
    vector_A = rests.vector_A
    columns = np.stack([vector_A.real, vector_A.imag, np.ones(vector_A.size)], axis=1)
    solved = np.linalg.lstsq(columns, rests.sensed_A, rcond=None)[0]
    gains = []
    for phase in range(3):
        gain = complex(solved[0, phase], solved[1, phase])
        if abs(gain) < DEAD_GAIN:
            raise IdentifyError(
                f"phase {'abc'[phase]}: {abs(gain):.2f} A are sensed for each ampere commanded: "
                "is it connected, and is its current the one named in the signal map?"
            )
        along = (gain * np.exp(-1j * PHASE_LAGS_RAD)).real
        nearest = int(np.argmax(np.abs(along)))
        if nearest != phase:
            raise IdentifyError(
                f"the current sensed as phase {'abc'[phase]} is that commanded in phase "
                f"{'abc'[nearest]}: exchange the names in [inverter.can.signals] feedback_i_A"
            )
        if along[phase] < 0:
            raise IdentifyError(
                f"the current sensed in phase {'abc'[phase]} has the opposite sign of its command: "
                "turn its sensor, or the sign of its signal's scale in the DBC"
            )
        gains.append(float(along[phase]))
    return gains[0], gains[1], gains[2]


@dataclass(frozen=True)
class TorqueResponse:
    """The measured torque compared with that which the motion of the encoder takes.

    direction: 1 or -1, in which the encoder counts under positive torque; 0 if it does not show.
    explained: part of the torque's variance that inertia and damping explain with that sign, and
    with the other. motion_Nm, torque_Nm (n,): torque that the motion takes by that fit, and the
    measured torque, drift and mean taken off both.
    """

    direction: int
    explained: tuple[float, float]
    motion_Nm: np.ndarray
    torque_Nm: np.ndarray


def torque_response(sweeps: Sequence[np.ndarray], counts: int) -> TorqueResponse:
    """Return how measured torque follows from the motion in the ticks of `sweeps`.

    Torque of the stator accelerates the rotor and overcomes friction and brake: inertia and damping
    are both positive, with one sign of the torque or the other.
    """
    parts = [_motion_and_torque(ticks, counts) for ticks in sweeps]
    motion, torque_Nm = np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
    total = float(torque_Nm @ torque_Nm)
    if total == 0.0:
        return TorqueResponse(0, (0.0, 0.0), torque_Nm, torque_Nm)
    fits = [nnls(motion, sign * torque_Nm) for sign in (1, -1)]
    explained = [1 - float(fit[1]) ** 2 / total for fit in fits]
    best = int(np.argmax(explained))
    seen = explained[best] > least_explained(explained[1 - best])
    direction = (1, -1)[best]
    return TorqueResponse(
        direction=direction if seen else 0,
        explained=(explained[best], explained[1 - best]),
        motion_Nm=direction * (motion @ fits[best][0]),
        torque_Nm=torque_Nm,
    )


def least_explained(reversed_explained: float) -> float:
    """Return the part of the variance above which a sign shows, by what the other explains."""
    return max(EXPLAINED_MIN, 2 * reversed_explained)


def _motion_and_torque(ticks: np.ndarray, counts: int) -> tuple[np.ndarray, np.ndarray]:
    """Return acceleration and speed (n, 2), and torque (n,) of a sweep, less drift and mean.

    All are means over the same triangle of +-HALF_S; samples are HALF_S apart. Ticks between two
    samples of the encoder repeat the time of the first.
    """
    ticks = rows_of(ticks, np.diff(ticks["t_ns"], prepend=0) > 0)
    if ticks.size < 2:
        return np.zeros((0, 2)), np.zeros(0)
    t_s = (ticks["t_ns"] - ticks["t_ns"][0]) * 1e-9
    if t_s[-1] < 10 * HALF_S:
        return np.zeros((0, 2)), np.zeros(0)
    period_s = float(np.median(np.diff(t_s)))
    half = max(round(HALF_S / period_s), 1)
    even_s = np.arange(0.0, t_s[-1], period_s)
    angle_rad = np.interp(even_s, t_s, unwrapped_rad(ticks["encoder_count"], counts))
    torque_Nm = np.interp(even_s, t_s, ticks["torque_Nm"].astype(float))
    width_s = half * period_s
    before, now, after = angle_rad[: -2 * half], angle_rad[half:-half], angle_rad[2 * half :]
    acceleration_rad_s2 = (after - 2 * now + before) / width_s**2
    speed_rad_s = (after - before) / (2 * width_s)
    triangle = np.convolve(np.full(half, 1 / half), np.full(half, 1 / half))
    smooth_Nm = np.convolve(torque_Nm, triangle, "same")[half:-half]
    all_s = np.stack([acceleration_rad_s2, speed_rad_s, smooth_Nm], axis=1)[::half]
    drift = np.stack([np.ones(all_s.shape[0]), even_s[half:-half:half]], axis=1)
    all_s = all_s - drift @ np.linalg.lstsq(drift, all_s, rcond=None)[0]
    return all_s[:, :2], all_s[:, 2]
