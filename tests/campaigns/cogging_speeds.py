"""Cogging torque of speeds whose gains differ: `python -m tests.campaigns.cogging_speeds [DRAWS]`.

Lines of order 48 (60 mNm), 16 and 96 at each speed, times a gain of its own, with noise of 0.2 mNm
per component, 6 turns; standard errors as turns show them. Prints in how many draws the interval of
order 48 holds its amplitude, and the median of its half. Exits with 1 below 90 %.
"""

import sys
from dataclasses import dataclass

import numpy as np

from motord.experiments.cogging.at_speed import SpeedCogging
from motord.experiments.cogging.estimate import average
from tests.campaigns import seeds
from tests.campaigns.driven import REPORT, bench_of

MOTOR = bench_of(REPORT)[0].motor
ORDER = np.array([16, 32, 48, 64, 80, 96])
LINE_NM = np.array([0.02, 0, 0.06j, 0, 0, -0.01])
MAIN = 2
"""Place of order 48."""

NOISE_NM, TURNS = 2e-4, 6
DRAWS = 2000
LEAST_HELD = 0.9


@dataclass(frozen=True)
class Speeds:
    """So many speeds in each direction, whose gains have this standard deviation."""

    number: int
    directions: int
    gain: float


ROWS = (
    Speeds(2, 2, 0.0),
    Speeds(2, 2, 0.004),
    Speeds(2, 2, 0.01),
    Speeds(2, 1, 0.03),
    Speeds(3, 1, 0.01),
    Speeds(6, 1, 0.0),
    Speeds(6, 1, 0.004),
    Speeds(6, 1, 0.01),
)


def drawn(speeds: Speeds, rng: np.random.Generator) -> list[SpeedCogging]:
    """Return what each speed of a run gives."""
    found = []
    for direction in (1, -1)[: speeds.directions]:
        for number in range(speeds.number):
            noise = rng.normal(0, NOISE_NM, (2, ORDER.size))
            shown = rng.chisquare(TURNS - 1, (2, ORDER.size)) / (TURNS - 1)
            gain = 1 + speeds.gain * rng.standard_normal()
            found.append(
                SpeedCogging(
                    speed_set_Hz=0.5 + 0.2 * number,
                    speed_Hz=0.5 + 0.2 * number,
                    direction=direction,
                    jerky=False,
                    motion_residual_counts=0.0,
                    turns=TURNS,
                    speed_ripple=0.0,
                    order=ORDER,
                    line_Nm=gain * LINE_NM + noise[0] + 1j * noise[1],
                    stderr_Nm=NOISE_NM * np.sqrt(np.maximum(shown, 1).mean(axis=0)),
                    spectrum_Nm=np.zeros(ORDER[-1], complex),
                    noise_Nm=np.full(ORDER[-1], NOISE_NM),
                )
            )
    return found


def coverage(speeds: Speeds, draws: int, seed: int) -> tuple[float, np.ndarray]:
    """Return the share of the draws that hold the amplitude, and halves of all intervals (Nm)."""
    rng = np.random.default_rng(seed)
    runs = [average(drawn(speeds, rng), MOTOR) for _ in range(draws)]
    half_Nm = np.array([one.half_width_Nm[MAIN] for one in runs])
    error_Nm = np.array([one.amplitude_Nm[MAIN] for one in runs]) - abs(LINE_NM[MAIN])
    return float((np.abs(error_Nm) < half_Nm).mean()), half_Nm


def main() -> int:
    """Print the table; return 1 where intervals hold too seldom."""
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else DRAWS
    (seed,) = seeds.several(1)
    lowest = 1.0
    for row in ROWS:
        held, half_Nm = coverage(row, draws, seed)
        lowest = min(lowest, held)
        print(
            f"{row.number} speeds, {row.directions} directions, gains {100 * row.gain:.1f} % "
            f"apart: {100 * held:.1f} % hold, +-{1e3 * np.median(half_Nm):.2f} mNm"
        )
    return 0 if lowest >= LEAST_HELD else 1


if __name__ == "__main__":
    sys.exit(main())
