"""Park transform: phase currents to d and q along the frame of a drive, and back; compiled.

d points along the magnets' flux, q a quarter of an electrical turn ahead, so that current along q
makes torque. Amplitude-invariant: a sine of amplitude 1 in the phases is of length 1 in d and q.
The zero sequence, what is common to all phases, has no place there; in a star there is none.

The currents of a command are those for the angle at which they flow. A drive that turns its
set-point with the rotor gets them as seen from there; one that makes phase currents of them when
they arrive, as seen from its angle then, which is older.
"""

import cmath
import math
from dataclasses import dataclass

import numpy as np

from motord.config import Config, DqConfig
from motord.jit import jit
from motord.schema import record_dtype

DQ_FRAME = record_dtype(
    [
        ("pole_pairs", "f8"),
        ("offset_rad", "f8"),  # electrical angle of the drive's d axis at angle 0
        ("sequence", "f8"),  # -1: the phases follow each other backwards
        ("direction", "f8"),  # -1: the drive's current along q makes negative torque
        ("scale", "f8"),  # what the drive calls 1 A of phase amplitude
        ("command_age_s", "f8"),  # of the drive's angle when its current flows
        ("feedback_age_s", "f8"),  # of the drive's angle when it senses currents
        ("turning", "i8"),  # the drive takes d and q; else nothing here means anything
        ("q_only", "i8"),
        ("sends_phases", "i8"),  # it sends phase currents, not d and q
    ]
)

_THIRD, _ROOT = 1.0 / 3.0, 1.0 / math.sqrt(3.0)


@jit
def abc_to_dq(
    electrical_rad: float, sequence: float, i_a: float, i_b: float, i_c: float
) -> tuple[float, float]:
    """Return d and q of three phase values, d at `electrical_rad`; the zero sequence is lost."""
    alpha = (2.0 * i_a - i_b - i_c) * _THIRD
    beta = sequence * (i_b - i_c) * _ROOT
    c, s = math.cos(electrical_rad), math.sin(electrical_rad)
    return alpha * c + beta * s, beta * c - alpha * s


@jit
def dq_to_abc(
    electrical_rad: float, sequence: float, i_d: float, i_q: float
) -> tuple[float, float, float]:
    """Return the phase values, of sum 0, whose `abc_to_dq` is d and q."""
    c, s = math.cos(electrical_rad), math.sin(electrical_rad)
    alpha, beta = i_d * c - i_q * s, i_d * s + i_q * c
    across = sequence * beta * 1.5 * _ROOT
    return alpha, across - 0.5 * alpha, -across - 0.5 * alpha


@jit
def turned(
    electrical_rad: float, sequence: float, i_a: float, i_b: float, i_c: float
) -> tuple[float, float, float]:
    """Return the phase values, of sum 0, `electrical_rad` further on in their turn."""
    i_d, i_q = abc_to_dq(0.0, sequence, i_a, i_b, i_c)
    return dq_to_abc(electrical_rad, sequence, i_d, i_q)


@dataclass(frozen=True)
class DqFrame:
    """The dq frame of a drive; angles are the bench's, in its positive direction.

    In `electrical_rad` the drive's angle is that of `[inverter.dq] d_axis_rad` ahead of the flux;
    all is as the drive has it, but for `direction`, which turns the sign of what is along q.
    """

    pole_pairs: int
    offset_rad: float
    sequence: int
    direction: int
    scale: float
    command_age_s: float
    feedback_age_s: float

    @classmethod
    def of(cls, config: Config) -> "DqFrame":
        """Return the frame that a bench file describes."""
        dq, motor = config.inverter.dq, config.motor
        flux_rad, sequence = flux_axis(motor.back_emf_table(), motor.pole_pairs)
        return cls(
            motor.pole_pairs,
            flux_rad + dq.direction * dq.d_axis_rad,
            sequence,
            dq.direction,
            dq.scale,
            *angle_ages_s(dq, 1.0 / config.loop.rate_Hz),
        )

    def to_drive(
        self, angle_rad: float, speed_rad_s: float, i_A: tuple[float, float, float]
    ) -> tuple[float, float]:
        """Return the command for the drive, (i_d, i_q), so that `i_A` flow at `angle_rad`."""
        electrical_rad = self._electrical_rad(angle_rad - speed_rad_s * self.command_age_s)
        i_d, i_q = abc_to_dq(electrical_rad, self.sequence, *i_A)
        return self.scale * i_d, self.scale * self.direction * i_q

    def from_drive(
        self, angle_rad: float, speed_rad_s: float, d: float, q: float
    ) -> tuple[float, float, float]:
        """Return the phase values, of sum 0, of what the drive sent at `angle_rad`."""
        electrical_rad = self._electrical_rad(angle_rad - speed_rad_s * self.feedback_age_s)
        q *= self.direction
        return dq_to_abc(electrical_rad, self.sequence, d / self.scale, q / self.scale)

    def _electrical_rad(self, angle_rad: float) -> float:
        return self.pole_pairs * angle_rad + self.offset_rad


def dq_frame_record(config: Config) -> np.ndarray:
    """Return the frame of a bench's drive as DQ_FRAME, shape (1,); zeros if it has none."""
    record = np.zeros(1, DQ_FRAME)
    can = config.inverter.can
    if config.inverter.driver == "can-dq" and can is not None:
        for name, value in vars(DqFrame.of(config)).items():
            record[name] = value
        record["turning"], record["q_only"] = True, can.signals.q_only
        record["sends_phases"] = bool(can.signals.feedback_i_A)
    return record


def flux_axis(back_emf: np.ndarray, pole_pairs: int) -> tuple[float, int]:
    """Return the electrical angle of the flux at angle 0, and the phases' sequence, 1 or -1.

    From the fundamental of the back-EMF (counts, 3), of which the flux is a quarter turn behind.
    """
    turn = np.exp(-2j * math.pi * pole_pairs * np.arange(len(back_emf)) / len(back_emf))
    lines = 2.0 / len(back_emf) * (turn @ back_emf)
    lag = cmath.exp(2j * math.pi / 3)
    forwards = complex(lines @ np.array([1, lag, lag**2])) / 3
    backwards = complex(lines @ np.array([1, lag**2, lag])) / 3
    sequence = 1 if abs(forwards) >= abs(backwards) else -1
    return cmath.phase(forwards if sequence > 0 else backwards) - math.pi / 2, sequence


def angle_ages_s(dq: DqConfig, period_s: float) -> tuple[float, float]:
    """Return how old the drive's angle is when its current flows, and when it senses currents.

    A command is in force for a period: one that makes phase currents of it once has, on the mean,
    an angle that is half a period older.
    """
    if dq.angle == "latched":
        return dq.angle_age_s + 0.5 * period_s, 0.0
    return dq.angle_age_s, dq.angle_age_s
