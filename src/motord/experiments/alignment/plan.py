"""`align`: a current vector turns slowly and takes the rotor along, forwards and back.

Nothing of where the rotor is enters the currents: torque is zero, and the vector is put on the
phases as it is. So this works on a bench whose phase order and encoder are not known yet.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from motord.config import Config
from motord.config.motor.back_emf import BackEmfTable
from motord.config.plans import AlignConfig
from motord.sequencing import Induced, OperatingPoint, Plan, PlanError
from motord.sequencing.capture import account, take_points
from motord.sequencing.limits import check_lasting_current
from motord.sequencing.motions import Capture, Motion, MotionFailed, restartable
from motord.sequencing.quality import GOOD
from motord.sequencing.settings import chosen

NAME = "align"

RATED_PARTS = (0.2, 0.4)
"""Currents unless others are set, in parts of the current that makes the rated torque."""

RAMP_S = 0.5
"""Time over which the current rises."""

LEAD_TURNS = 0.5
"""Electrical turns before the first stop: wherever it stood, the rotor is caught by then."""

STEP_MAX_S = 0.1
"""Time by which the vector goes on from one observation to the next at most: a supervisor that was
kept from running must not make it jump, as the rotor could not follow."""

FOLLOWED_PART = 0.5
"""Part of the vector's path that a rotor that follows has turned at least."""

FURTHEST_PART = 1.5
"""The path of the rotor, in parts of the vector's, beyond which the sweep is ended."""

PHASES_RAD = (0.0, 2 * math.pi / 3, 4 * math.pi / 3)


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.align]` with `settings`. Raises PlanError."""
    own = chosen(config, NAME, AlignConfig, settings)
    if config.inverter.driver == "can-dq":
        raise PlanError(
            f"{NAME}: a drive that takes currents along d and q has an angle of its own, by which "
            "the current vector would turn: align it by its own tool, and fill in [inverter.dq]"
        )
    if isinstance(config.motor.back_emf, BackEmfTable):
        raise PlanError(
            f"{NAME}: [motor] back_emf is a measured table, which has direction and zero in it: "
            "there is nothing to align; name harmonics to align anew"
        )
    own = own.model_copy(update={"currents_A": _currents_A(config, own)})
    check_lasting_current(config, max(own.currents_A))
    sweeps = tuple(
        Sweep(amplitude_A, direction, own, config.motor.pole_pairs)
        for amplitude_A in own.currents_A
        for direction in (1, -1)
    )
    return Plan(
        name=NAME,
        points=tuple(
            OperatingPoint(index, 0.0, 0.0, 0, aim=sweep.aim) for index, sweep in enumerate(sweeps)
        ),
        motion=partial(take_points, partial(turn_vector, sweeps=sweeps)),
        point_s=partial(_sweep_s, sweeps),
        settings=own.model_dump(mode="json"),
        needs="",
    )


def _currents_A(config: Config, own: AlignConfig) -> tuple[float, ...]:
    """Return the amplitudes of the vector (A), smallest first."""
    if own.currents_A:
        return tuple(sorted(own.currents_A))
    table = config.motor.back_emf_table()
    rms_V_s_per_rad = math.sqrt(float((table**2).mean()))
    rated_A = math.sqrt(2) / 3 * config.motor.rated_torque_Nm / rms_V_s_per_rad
    return tuple(float(f"{part * rated_A:.3g}") for part in RATED_PARTS)


@dataclass(frozen=True)
class Sweep:
    """A current vector that is turned from stop to stop, in direction 1 (a, b, c) or -1.

    Times are since the first move to a stop began, negative before.
    """

    amplitude_A: float
    direction: int
    own: AlignConfig
    pole_pairs: int

    @property
    def aim(self) -> str:
        """What is done, for an operator."""
        return f"{self.amplitude_A:g} A turned {'a, b, c' if self.direction > 0 else 'a, c, b'}"

    @property
    def lead_s(self) -> float:
        """How long the rotor is taken along before, with the current raised."""
        return LEAD_TURNS * self.own.rests * self.own.move_s

    @property
    def stop_s(self) -> float:
        """Time from stop to stop."""
        return self.own.move_s + self.own.hold_s

    @property
    def end_s(self) -> float:
        """Time of the end of the last stop."""
        return (self.own.turns * self.own.rests + 1) * self.stop_s

    @property
    def path_rad(self) -> float:
        """How far the stops take the rotor."""
        return 2 * math.pi * self.own.turns / self.pole_pairs

    def angle_rad(self, time_s: float) -> float:
        """Return the vector's electrical angle."""
        step = 1.0 / self.own.rests
        if time_s < 0:
            turns = -step + LEAD_TURNS * max(time_s / self.lead_s, -1.0)
        else:
            stop = math.floor(time_s / self.stop_s)
            moved = min((time_s - stop * self.stop_s) / self.own.move_s, 1.0)
            turns = (stop - 1 + moved) * step
        return 2 * math.pi * (turns if self.direction > 0 else self.own.turns - turns)


def vector_A(amplitude_A: float, angle_rad: float) -> tuple[float, float, float]:
    """Return the phases' currents (A) of a vector at an electrical angle."""
    a, b, c = (amplitude_A * math.cos(angle_rad - phase_rad) for phase_rad in PHASES_RAD)
    return a, b, c


def _sweep_s(sweeps: tuple[Sweep, ...], point: OperatingPoint) -> float:
    sweep = sweeps[point.index]
    return RAMP_S + sweep.lead_s + sweep.end_s


@restartable
def turn_vector(point: OperatingPoint, sweeps: tuple[Sweep, ...]) -> Motion[Capture]:
    """Ramp the current up, turn the vector to the first stop, capture from there to the last.

    The torque set-point is zero; the currents are put on it as an induced offset, which the loop
    limits and switches off as any other.
    """
    sweep = sweeps[point.index]
    began = seen = yield None
    free = began.demand.at_rest(enabled=True, compensate=0, brake=sweep.own.brake)
    name = f"{sweep.amplitude_A:g} A {'forwards' if sweep.direction > 0 else 'backwards'}"
    far_rad = FURTHEST_PART * (sweep.path_rad + 2 * math.pi / sweep.pole_pairs)
    passed_s, first_stop = 0.0, None
    while (time_s := passed_s - RAMP_S - sweep.lead_s) < sweep.end_s:
        turned_rad = abs(seen.turned_rad - began.turned_rad)
        if turned_rad > far_rad:
            raise MotionFailed(f"{seen.demand.label}: {_too_far(turned_rad, sweep)}")
        if time_s >= 0:
            first_stop = first_stop or seen
        amplitude_A = sweep.amplitude_A * min(passed_s / RAMP_S, 1.0)
        before = seen
        seen = yield replace(
            free,
            plan_point=point.index if first_stop else -1,
            induced=Induced(offset_A=vector_A(amplitude_A, sweep.angle_rad(time_s))),
            label=f"{name}: {'from stop to stop' if first_stop else 'catching the rotor'}",
        )
        passed_s += min(seen.since_s(before), STEP_MAX_S)
    turned_rad = abs(seen.turned_rad - (first_stop or began).turned_rad)
    if turned_rad < FOLLOWED_PART * sweep.path_rad:
        raise MotionFailed(f"{seen.demand.label}: {_not_followed(turned_rad, sweep)}")
    return account(
        point,
        seen,
        GOOD,
        turns=round(abs(seen.point_turns), 4),
        sweep={"amplitude_A": sweep.amplitude_A, "way": sweep.direction},
    )


def _too_far(turned_rad: float, sweep: Sweep) -> str:
    return (
        f"the rotor turned {turned_rad / (2 * math.pi):.2g} turns, further than the "
        f"current vector takes it with [motor] pole_pairs = {sweep.pole_pairs}: are pole_pairs "
        "and counts right, is nothing else turning it?"
    )


def _not_followed(turned_rad: float, sweep: Sweep) -> str:
    return (
        f"the rotor turned {turned_rad / (2 * math.pi):.2g} turns where the "
        f"current vector goes {sweep.path_rad / (2 * math.pi):.2g}: is it free, are all "
        "three phases connected, is the current enough for friction and cogging torque "
        "(currents_A), are pole_pairs and counts right?"
    )
