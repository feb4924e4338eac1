"""Trends of a soak on series of known slope: `python -m tests.campaigns.soak`.

Soaks of 12 figures, residuals correlated by rho from one repetition to the next. For each rho and
number of repetitions: share of 95 % intervals that hold the slope, share of soaks without a drift
that claim one, share of the drifts of 10 standard deviations of a figure that are found, and of
the soaks that note a correlation beyond what is kept. Exits with 1 if coverage or false drifts are
not kept up to CORRELATION_MAX.

`python -m tests.campaigns.soak departures 200`: soaks in which half of the figures warm up, or one
has a step: of 50 repetitions at any place, of fewer half way.
"""

import sys

import numpy as np

from motord.experiments.soak.step import FALSE_ALARMS, Step, most_likely_step
from motord.experiments.soak.trend import CORRELATION_MAX, DriftSlope, slope
from motord.intervals import beyond_chance
from tests.campaigns import departed, seeds

SOAKS, FIGURES = 400, 12
REPETITIONS, CORRELATIONS = (6, 8, 10, 20, 50), (0.0, 0.5, 0.8, 0.9, 0.95)
FALSE_DRIFTS, COVERED = 0.05, 0.94
DRIFT = 10.0


def residuals(rng: np.random.Generator, n: int, correlation: float) -> np.ndarray:
    """Return residuals (n,) with a standard deviation of 1, each correlated with the one before."""
    values = rng.normal(size=n)
    for place in range(1, n):
        values[place] *= np.sqrt(1 - correlation**2)
        values[place] += correlation * values[place - 1]
    return values


def claimed(slopes: list[DriftSlope]) -> list[bool]:
    """Return which of the figures of a soak are said to drift."""
    return beyond_chance([one.p_value for one in slopes], FALSE_DRIFTS)


def trial(n: int, correlation: float, seed: int) -> tuple[float, float, float, float]:
    """Return the shares of a soak: covered, false drift, drift found, correlation noted."""
    rng = np.random.default_rng([seed, n, round(100 * correlation)])
    at = np.linspace(0.0, 1.0, n)
    steady = [slope(at, residuals(rng, n, correlation)) for _ in range(FIGURES)]
    drift = slope(at, DRIFT * at + residuals(rng, n, correlation))
    return (
        float(np.mean([abs(one.value) <= (one.half_width or 0.0) for one in steady])),
        float(any(claimed(steady))),
        float(claimed([drift, *steady[1:]])[0]),
        float(np.median([one.correlation or 0.0 for one in steady]) > CORRELATION_MAX),
    )


def main(soaks: int = SOAKS) -> int:
    """Print the shares; return 1 if those up to CORRELATION_MAX are not kept."""
    failed = 0
    most = FALSE_DRIFTS + departed.SLACK * np.sqrt(FALSE_DRIFTS * (1 - FALSE_DRIFTS) / soaks)
    least = COVERED - departed.SLACK * np.sqrt(COVERED * (1 - COVERED) / (soaks * FIGURES))
    print("repetitions   rho  covered  false drifts  found  noted")
    for n in REPETITIONS:
        for correlation in CORRELATIONS:
            trials = [trial(n, correlation, seed) for seed in seeds.several(soaks)]
            covered, false, found, noted = np.mean(trials, axis=0)
            kept = covered >= least and false <= most
            failed += not kept and correlation <= CORRELATION_MAX
            shares = f"{covered:8.1%} {false:13.1%} {found:6.0%} {noted:6.0%}"
            print(f"{n:11} {correlation:5.2f} {shares}{'' if kept else '  not kept'}", flush=True)
    return int(failed > 0)


STEP_REPETITIONS, STEPS = 50, (5.0, 10.0)
FEW = (10, 20)
"""Repetitions of soaks whose step is half way, by the largest of STEPS."""
WARM_UPS = (0.05, 0.1, 0.2)
"""Time constants, in parts of a soak, give or take a quarter; by 5 standard deviations."""


def steps_claimed(rng: np.random.Generator, courses: np.ndarray) -> list[Step | None]:
    """Return the steps of the figures with courses (k, n) and noise, None where none is claimed."""
    at_h = np.linspace(0.0, courses.shape[1] / 10, courses.shape[1])
    found = [most_likely_step(at_h, rng.normal(size=at_h.size) + one) for one in courses]
    p_values = [one.p_value if one else None for one in found]
    pairs = zip(found, beyond_chance(p_values, FALSE_ALARMS), strict=True)
    return [one if claimed else None for one, claimed in pairs]


def warm_up(part: float, seed: int) -> bool:
    """Return whether a soak claims a step, in which half of the figures warm up."""
    rng = np.random.default_rng([seed, round(100 * part)])
    courses, at = np.zeros((FIGURES, STEP_REPETITIONS)), np.linspace(0.0, 1.0, STEP_REPETITIONS)
    courses[: FIGURES // 2] = 5.0 * (1 - np.exp(-at / (part * rng.uniform(0.8, 1.25))))
    return any(one is not None for one in steps_claimed(rng, courses))


def stepping(size: float, seed: int, n: int = STEP_REPETITIONS) -> tuple[bool, bool]:
    """Return whether the step of one figure is claimed, and whether its interval holds its size."""
    rng = np.random.default_rng([seed, round(10 * size)])
    place = n // 2 if n < STEP_REPETITIONS else int(rng.integers(4, n - 4))
    courses = np.zeros((FIGURES, n))
    courses[0, place:] = size
    found = steps_claimed(rng, courses)[0]
    return found is not None, found is not None and abs(found.value - size) <= found.half_width


def departures(soaks: int = SOAKS) -> int:
    """Print the shares of soaks in which a step is claimed; return 1 if too many warm-ups do."""
    share, trials = 0.0, len(WARM_UPS) * soaks
    most = FALSE_ALARMS + departed.SLACK * np.sqrt(FALSE_ALARMS * (1 - FALSE_ALARMS) / trials)
    for part in WARM_UPS:
        claimed = float(np.mean([warm_up(part, seed) for seed in seeds.several(soaks)]))
        share += claimed / len(WARM_UPS)
        print(f"warm-up, time constant {part} of the soak: a step in {claimed:.1%}", flush=True)
    print(f"all warm-ups: a step in {share:.1%}")
    for size, n in [*((size, STEP_REPETITIONS) for size in STEPS), *((STEPS[-1], n) for n in FEW)]:
        several = seeds.several(soaks)
        found, held = np.sum([stepping(size, seed, n) for seed in several], axis=0)
        print(
            f"{n} repetitions, step of {size:g}: found in {found / soaks:.0%}, "
            f"held in {held} of {found}"
        )
    return int(share > most)


if __name__ == "__main__":
    sys.exit(departed.run(main, departures))
