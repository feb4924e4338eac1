"""Turn a current vector of one amplitude one way, with stops at which the rotor comes to rest."""

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from motord.config import AlignConfig
from motord.sequencing.observation import Observation
from motord.sequencing.quality import GOOD
from motord.sequencing.steps import (
    NOTHING_INDUCED,
    Advance,
    Demand,
    Induced,
    OperatingPoint,
    Outcome,
)

RAMP_S = 0.5
"""Time over which the current rises."""

LEAD_TURNS = 0.5
"""Electrical turns before the first stop: wherever it stood, the rotor is caught by then."""

LOOK_MAX_S = 0.1
"""Time of the vector's way that passes in one look at most: a supervisor that was kept from
running must not make it jump, as the rotor could not follow."""

FOLLOWED = 0.5
"""Part of the vector's way that a rotor that follows has turned at least."""

FURTHEST = 1.5
"""The way of the rotor, in parts of the vector's, beyond which the sweep is ended."""

PHASES = (0.0, 2 * math.pi / 3, 4 * math.pi / 3)


@dataclass(frozen=True)
class Sweep:
    """What is turned: amplitude, and 1 for the way a, b, c or -1 for the other."""

    amplitude_A: float
    way: int

    @property
    def aim(self) -> str:
        """Say what is done."""
        return f"{self.amplitude_A:g} A turned {'a, b, c' if self.way > 0 else 'a, c, b'}"


def vector_A(amplitude_A: float, angle_rad: float) -> tuple[float, float, float]:
    """Return the phases' currents (A) of a vector at an electrical angle."""
    a, b, c = (amplitude_A * math.cos(angle_rad - lag) for lag in PHASES)
    return a, b, c


class Phase(Enum):
    """What is being done."""

    LEAD = "catching the rotor"
    STOPS = "from stop to stop"


@dataclass
class TakeSweep:
    """Ramps the current up, turns the vector through half a turn, then marks the stops.

    The torque set-point is zero; the currents are put on it as an induced offset, which the loop
    limits and switches off as any other.
    """

    point: OperatingPoint
    sweep: Sweep
    own: AlignConfig
    pole_pairs: int
    phase: Phase = Phase.LEAD
    _seen_ns: int = 0
    _passed_s: float = 0.0
    _began_rad: float = 0.0
    _marked_rad: float = 0.0

    @property
    def label(self) -> str:
        """Current, way and phase in words."""
        way = "forwards" if self.sweep.way > 0 else "backwards"
        return f"{self.sweep.amplitude_A:g} A {way}: {self.phase.value}"

    def begin(self, seen: Observation) -> None:
        """Start over without current."""
        self.phase, self._seen_ns, self._passed_s = Phase.LEAD, seen.t_ns, 0.0
        self._began_rad = seen.turned_rad

    def seconds(self) -> float:
        """Return ramp, lead and stops together (s)."""
        return RAMP_S + self._lead_s + self._stops * self._stop_s

    @property
    def _stops(self) -> int:
        return self.own.turns * self.own.rests + 1

    @property
    def _stop_s(self) -> float:
        return self.own.move_s + self.own.hold_s

    @property
    def _lead_s(self) -> float:
        return LEAD_TURNS * self.own.rests * self.own.move_s

    @property
    def _way_rad(self) -> float:
        """How far the vector takes the rotor while it is marked."""
        return 2 * math.pi * self.own.turns / self.pole_pairs

    def advance(self, seen: Observation, demand: Demand) -> Advance:
        """Go on along the vector's way."""
        self._passed_s += min((seen.t_ns - self._seen_ns) * 1e-9, LOOK_MAX_S)
        self._seen_ns = seen.t_ns
        led_s = self._passed_s - RAMP_S - self._lead_s
        if self.phase is Phase.LEAD and led_s >= 0:
            self.phase, self._marked_rad = Phase.STOPS, seen.turned_rad
        free = replace(demand, enabled=True, torque_Nm=0.0, compensate=0, plan_point=-1)
        if led_s >= self._stops * self._stop_s:
            return self._end(seen, replace(free, induced=NOTHING_INDUCED))
        way_rad = abs(seen.turned_rad - self._began_rad)
        if way_rad > FURTHEST * (self._way_rad + 2 * math.pi / self.pole_pairs):
            return Advance(free, Outcome.FAILED, self._why_far(way_rad))
        offset_A = vector_A(self._amplitude_A(), self._angle_rad(led_s))
        return Advance(
            replace(
                free,
                brake=self.own.brake,
                plan_point=self.point.index if self.phase is Phase.STOPS else -1,
                induced=Induced(offset_A=offset_A),
            )
        )

    def _amplitude_A(self) -> float:
        return self.sweep.amplitude_A * min(self._passed_s / RAMP_S, 1.0)

    def _angle_rad(self, led_s: float) -> float:
        """Return the vector's electrical angle, `led_s` after the first move to a stop began."""
        step = 1.0 / self.own.rests
        if led_s < 0:
            turns = -step + LEAD_TURNS * max(led_s / self._lead_s, -1.0)
        else:
            stop = math.floor(led_s / self._stop_s)
            moved = min((led_s - stop * self._stop_s) / self.own.move_s, 1.0)
            turns = (stop - 1 + moved) * step
        return 2 * math.pi * (turns if self.sweep.way > 0 else self.own.turns - turns)

    def _why_far(self, way_rad: float) -> str:
        return (
            f"{self.label}: the rotor turned {way_rad / (2 * math.pi):.2g} turns, further than the "
            f"current vector takes it with [motor] pole_pairs = {self.pole_pairs}: are pole_pairs "
            "and counts right, is nothing else turning it?"
        )

    def _end(self, seen: Observation, demand: Demand) -> Advance:
        turned_rad = abs(seen.turned_rad - self._marked_rad)
        if turned_rad < FOLLOWED * self._way_rad:
            return Advance(
                demand,
                Outcome.FAILED,
                f"{self.label}: the rotor turned {turned_rad / (2 * math.pi):.2g} turns where the "
                f"current vector goes {self._way_rad / (2 * math.pi):.2g}: is it free, are all "
                "three phases connected, is the current enough for friction and cogging torque "
                "(currents_A), are pole_pairs and counts right?",
            )
        return Advance(demand, Outcome.DONE, point=self._account(seen))

    def _account(self, seen: Observation) -> dict[str, Any]:
        """Return the sweep as it was taken (topic `/operating_point`)."""
        return {
            "index": self.point.index,
            "torque_Nm": 0.0,
            "speed_Hz": 0.0,
            "tick_start": seen.point_first_tick,
            "tick_end": seen.tick,
            "t_start_ns": seen.point_first_t_ns,
            "t_end_ns": seen.t_ns,
            "turns": round(abs(seen.point_turns), 4),
            "speed_mean_Hz": round(seen.point_speed_Hz, 5),
            "brake": self.own.brake,
            "compensate": 0,
            "quality": GOOD,
            "sweep": {"amplitude_A": self.sweep.amplitude_A, "way": self.sweep.way},
        }
