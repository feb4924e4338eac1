"""Back-EMF of a driven rotor whose bench departs: `python -m tests.campaigns.driven_departures 20`.

A second argument chooses the departures that have it in their names.

A rotor of known back-EMF is turned at three speeds in both directions, one departure at a time. It
shares no code with motord's own rig. Prints for each in how many trials the 95 % intervals of the
electrical orders hold the truth, amplitudes and phases, and the findings. Exits with 1 where those
of one hold it too seldom (`departed`), or a finding that is expected is missing.
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import radians

import numpy as np
from scipy.signal import lfilter, lfilter_zi

from motord.config import load
from motord.experiments.back_emf.estimate import measure
from motord.experiments.back_emf.result import MeasuredBackEmf
from motord.identification.operating_points import PointData
from motord.intervals import coverage_factor
from motord.schema import record_dtype
from tests.campaigns import departed, seeds

SEEDS = 20
MOTOR = load().motor
RATE_HZ = 1000
FINE = 4
"""Steps of a sample, where a filter is followed."""

TURNS, BETWEEN_S = 10, 5.0
ONE_WAY_HZ = (0.53, 0.87, 1.37)
EMF = {1: (0.206, 0.0), 3: (0.0093, 0.4), 5: (0.0041, -0.7), 7: (0.0021, 0.2)}
"""Amplitude (V s/rad) and phase (rad) of the electrical orders."""

TICKS = record_dtype(
    [("t_ns", "i8"), ("encoder_count", "i4")]
    + [
        (f"{name}_{phase}_{unit}", "f8")
        for name, unit in (("u", "V"), ("i", "A"))
        for phase in "abc"
    ]
)


@dataclass(frozen=True)
class Bench:
    """What departs; by default nothing but noise of the voltages.

    encoder (rad), speed_ripple (parts): amplitudes by order per turn. magnets: part of the back-EMF
    that is gone at the end. gains, offset_V, lowpass_s: of the voltage channels. clock: of the
    inverter against the encoder's, in parts, alike when the run begins. torsion: amplitude in parts
    of the speed, decay (s) and frequency (Hz) of a swing that each speed begins with.
    """

    encoder: Mapping[int, float] = field(default_factory=dict)
    speed_ripple: Mapping[int, float] = field(default_factory=dict)
    magnets: float = 0.0
    gains: tuple[float, float, float] = (1.0, 1.0, 1.0)
    offset_V: float = 0.0
    lowpass_s: float = 0.0
    clock: float = 0.0
    torsion: tuple[float, float, float] = (0.0, 1.0, 1.0)
    speeds_Hz: Sequence[float] = (*ONE_WAY_HZ, *(-one for one in reversed(ONE_WAY_HZ)))

    @property
    def duration_s(self) -> float:
        return sum(BETWEEN_S + (TURNS + 0.5) / abs(one) for one in self.speeds_Hz)


BOTH = {1: 0.02, 2: 0.02, 16: 0.01, 48: 0.01}
DEPARTURES: Mapping[str, tuple[Bench, str]] = {
    "none": (Bench(), ""),
    "encoder 0.1 deg once a turn": (Bench(encoder={1: radians(0.1)}), "encoder-error-order-1"),
    "encoder 0.3 deg once a turn": (Bench(encoder={1: radians(0.3)}), "encoder-error-order-1"),
    "encoder 1 deg once a turn": (Bench(encoder={1: radians(1.0)}), "encoder-error-order-1"),
    "encoder 0.3 deg twice a turn": (Bench(encoder={2: radians(0.3)}), "encoder-error-order-2"),
    "magnets 0.5 % weaker at the end": (Bench(magnets=0.005), "amplitude-drifts"),
    "the same, one direction": (Bench(magnets=0.005, speeds_Hz=ONE_WAY_HZ), ""),
    "low-pass 0.2 ms of the voltages": (Bench(lowpass_s=2e-4), ""),
    "low-pass 1 ms of the voltages": (Bench(lowpass_s=1e-3), "amplitude-of-frequency"),
    "the same, one direction ": (Bench(lowpass_s=1e-3, speeds_Hz=ONE_WAY_HZ), ""),
    "gain of a phase 0.5 %": (Bench(gains=(1.005, 0.9975, 0.9975)), "phases-differ"),
    "offset 0.1 V": (Bench(offset_V=0.1), ""),
    "speed ripple 2 % once, twice, 1 % of 16, 48": (Bench(speed_ripple=BOTH), ""),
    "clocks 50 ppm apart": (Bench(clock=5e-5), "clocks-drift"),
    "clocks 50 ppm apart, one direction": (
        Bench(clock=5e-5, speeds_Hz=ONE_WAY_HZ),
        "age-of-voltages",
    ),
    "clocks 20 ppm apart, one direction": (Bench(clock=2e-5, speeds_Hz=ONE_WAY_HZ), ""),
    "torsional swing 20 % at 9 Hz": (Bench(torsion=(0.2, 5.0, 9.0)), "jerky-motion"),
}
"""Departures and the finding that names each, "" where none has to."""

POWER = {"low-pass 1 ms of the voltages": 0.975}
"""Share of many trials that are named, where not all are: a test that chance passes in 0.1 % wants
8.6 standard errors at four degrees of freedom, and a slope that is known to 1/13 of itself has
less where the captures happen to scatter more."""


def back_emf(angle_rad: np.ndarray) -> np.ndarray:
    """Return k of the phases (n, 3) at angles (n,)."""
    turned = MOTOR.pole_pairs * angle_rad[:, None] - 2 * np.pi / 3 * np.arange(3)
    return np.asarray(sum(k * np.sin(h * turned + phase) for h, (k, phase) in EMF.items()))


def captured(bench: Bench, seed: int) -> list[PointData]:
    """Return the captures of all speeds."""
    rng, began_s, points = np.random.default_rng(seed), 0.0, []
    phases = rng.uniform(0, 2 * np.pi, (2, 64))
    for speed_Hz in bench.speeds_Hz:
        points.append(_capture(bench, rng, speed_Hz, began_s, phases))
        began_s += BETWEEN_S + (TURNS + 0.5) / abs(speed_Hz)
    return points


def _capture(
    bench: Bench, rng: np.random.Generator, speed_Hz: float, began_s: float, phases: np.ndarray
) -> PointData:
    start_rad, mean_rad_s = rng.uniform(0, 2 * np.pi), 2 * np.pi * speed_Hz
    swing, decay_s, swing_Hz = bench.torsion

    def angle_at(at_s: np.ndarray) -> np.ndarray:
        angle_rad = start_rad + mean_rad_s * at_s
        for order, share in bench.speed_ripple.items():
            turned = order * mean_rad_s * at_s + phases[0, order]
            angle_rad = angle_rad + share / order * np.sin(turned)
        wave = np.exp(-at_s / decay_s) * np.sin(2 * np.pi * swing_Hz * at_s)
        return np.asarray(angle_rad + swing * speed_Hz / swing_Hz * wave)

    fine = FINE if bench.lowpass_s else 1
    t_s = np.arange(0, (TURNS + 0.5) / abs(speed_Hz), 1 / (fine * RATE_HZ))
    at_s = t_s - bench.clock * (began_s + t_s)
    k = back_emf(angle_at(at_s)) * (1 - bench.magnets * (began_s + t_s[:, None]) / bench.duration_s)
    u_V = 5e4 * (angle_at(at_s + 1e-5) - angle_at(at_s - 1e-5))[:, None] * k
    if bench.lowpass_s:
        rest = np.exp(-1 / (bench.lowpass_s * fine * RATE_HZ))
        b, a = [1 - rest], [1, -rest]
        u_V = lfilter(b, a, u_V, axis=0, zi=lfilter_zi(b, a)[:, None] * u_V[:1])[0]
    t_s, u_V = t_s[::fine], u_V[::fine] * bench.gains + bench.offset_V
    angle_rad = angle_at(t_s)
    for order, error_rad in bench.encoder.items():
        angle_rad = angle_rad + error_rad * np.sin(order * angle_at(t_s) + phases[1, order])
    ticks = np.zeros(t_s.size, TICKS)
    ticks["t_ns"] = np.round((began_s + t_s) * 1e9).astype(np.int64)
    ticks["encoder_count"] = np.rint(angle_rad / (2 * np.pi) * MOTOR.counts) % MOTOR.counts
    for place, phase in enumerate("abc"):
        ticks[f"u_{phase}_V"] = u_V[:, place] + 0.02 * rng.standard_normal(t_s.size)
    return PointData(0.0, abs(speed_Hz), ticks)


def errors_over_half_widths(found: MeasuredBackEmf) -> np.ndarray:
    """Return the errors of amplitude and phase over their half-widths (orders, 2)."""
    rows = []
    for one in found.harmonics:
        if one.order in EMF:
            k, phase = EMF[one.order]
            turned = np.angle(np.exp(1j * (one.phase_rad - phase)))
            half = coverage_factor(one.degrees_of_freedom) * one.stderr_V_s_per_rad
            phase_half = coverage_factor(one.phase_degrees_of_freedom) * one.phase_stderr_rad
            rows.append(((one.amplitude_V_s_per_rad - k) / half, turned / phase_half))
    return np.array(rows)


def trial(bench: Bench, seed: int) -> departed.Trial:
    """Return what a run shows."""
    found = measure(captured(bench, seed), MOTOR)
    ratios = zip(EMF, np.abs(errors_over_half_widths(found)), strict=True)
    held = {
        f"{what} {order}": bool(ratio <= 1)
        for order, both in ratios
        for what, ratio in zip(("amplitude", "phase"), both, strict=True)
    }
    return departed.Trial(held, found.findings)


def main(count: int = SEEDS, rows: str = "") -> int:
    """Run the departures with `rows` in their names, print what they show; return the exit code."""
    kept = [
        departed.judge(
            name,
            [departed.attempted(partial(trial, bench), seed) for seed in seeds.several(count)],
            named=finding,
            power=POWER.get(name, 1.0),
        )
        for name, (bench, finding) in DEPARTURES.items()
        if rows in name
    ]
    return int(not all(kept))


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS, *sys.argv[2:3]))
