"""At the least `encoder_jump_rad` that is legal a rotor that is well never seems to jump."""

import math

import numpy as np
import pytest

from motord.config import Config
from motord.config.rules.encoder import least_jump_rad
from motord.config.timing import ACCELERATION_RAD_S2, POSITION_AGE_MAX_S, SAMPLE_TIME_S
from motord.control.observer import TWO_PI, observe
from motord.control.types import MEMORY, PARAMETERS
from motord.jit import jit
from tests.unit.control.bench import Bench, make_config

TIME_S = 10.0
STEPS_OF_TIME_PER_S = 1.0


@jit
def largest_part(
    p: np.record,
    m: np.record,
    dt_s: np.ndarray,
    a_rad_s2: np.ndarray,
    off_s: np.ndarray,
    top: float,
) -> float:
    """Return the largest jump of samples, as a part of what is plausible.

    dt_s (n,): times between samples, a_rad_s2 (n,): accelerations in these, up to the speed `top`,
    off_s (n,): by what the samples' times are off.
    """
    t_s = speed_rad_s = worst = 0.0
    angle_rad = 1.0
    for index in range(len(dt_s)):
        before_rad_s = speed_rad_s
        speed_rad_s = min(max(speed_rad_s + a_rad_s2[index] * dt_s[index], -top), top)
        angle_rad += 0.5 * (before_rad_s + speed_rad_s) * dt_s[index]
        t_s += dt_s[index]
        t_ns = int((t_s + off_s[index]) * 1e9)
        count = math.floor(angle_rad / TWO_PI * p.counts + 0.5) % p.counts
        if m.tracking:
            since_s = (t_ns - m.t_ns) * 1e-9
            jump_rad = TWO_PI * count / p.counts - m.angle_rad - m.speed_rad_s * since_s
            jump_rad -= TWO_PI * math.floor((jump_rad + math.pi) / TWO_PI)
            worst = max(worst, abs(jump_rad) / (p.encoder_jump_rad * max(since_s / 0.005, 1.0)))
        observe(p, m, t_ns, count)
    return worst


def drawn_bench(rng: np.random.Generator) -> Config | None:
    """Return a bench with the least jump that is legal for it, None where none is."""
    rate_Hz = int(rng.choice([100, 200, 333, 1000, 2000, 5000]))
    bridge_Hz = round(max(rate_Hz * float(rng.choice([0.5, 1.0, 1.3, 2.48, 2.93])), 100))
    stale_after_s = max(2.0 / min(rate_Hz, bridge_Hz), float(rng.choice([0.005, 0.01, 0.02, 0.1])))
    sections = {
        "loop": {
            "rate_Hz": rate_Hz,
            "observer_bandwidth_Hz": float(rng.choice([15, 30, 100, 500, 1000])),
        },
        "bridge": {"rate_Hz": bridge_Hz, "stale_after_s": stale_after_s},
        "inverter": {"stale_after_s": 0.1, "timeout_s": 0.1},
        "motor": {"counts": int(rng.choice([64, 189, 512, 4096, 65536]))},
    }
    limits = {"trip_speed_rad_s": float(rng.choice([5.0, 20.0, 60.0, 150.0]))}
    try:
        loose = make_config(limits=limits | {"encoder_jump_rad": 1.57}, **sections)
    except ValueError:
        return None
    return make_config(limits=limits | {"encoder_jump_rad": least_jump_rad(loose)}, **sections)


def spacings_s(config: Config, rng: np.random.Generator, *, drops: bool) -> np.ndarray:
    """Return the times between the samples that the loop sees, each the newest at a tick."""
    bridge_Hz, interval_s = config.sample_rate_Hz, config.sample_interval_s
    gap_s = max(min(config.bridge.stale_after_s, POSITION_AGE_MAX_S), interval_s)
    ticks = np.arange(round(TIME_S * config.loop.rate_Hz)) + rng.random()
    newest = np.unique(np.floor(ticks * bridge_Hz / config.loop.rate_Hz))
    if drops:
        most = max(int(gap_s / interval_s + 1e-9), 1)
        lost = rng.integers(1, most + 1, len(newest))
        seen = np.cumsum(np.where(rng.random(len(newest)) < 0.05, lost, 1))
        newest = newest[seen[seen < len(newest)]]
    return np.minimum(np.diff(newest) / bridge_Hz, gap_s)


def largest_jump(config: Config, rng: np.random.Generator, *, drops: bool) -> float:
    """Return how close a sound encoder comes to what is taken for a jump, at worst (1: it is)."""
    interval_s, dt_s = config.sample_interval_s, spacings_s(config, rng, drops=drops)
    n = len(dt_s)
    turns = np.arange(n) // int(rng.integers(1, 1000)) % 2 * 2.0 - 1.0
    turns[: round(0.1 / interval_s)] = 0.0  # the observer starts with a rotor at rest
    moved = rng.random(n) < STEPS_OF_TIME_PER_S * interval_s
    off_s = SAMPLE_TIME_S * rng.random(n)[np.maximum.accumulate(np.where(moved, np.arange(n), 0))]
    if config.sample_rate_Hz * 4 * SAMPLE_TIME_S > 1.0:
        off_s = np.zeros(n)
    bench, memory = Bench(config), np.zeros(1, MEMORY)
    assert bench.parameters.dtype == PARAMETERS
    return largest_part(
        bench.parameters[0], memory[0], dt_s, ACCELERATION_RAD_S2 * turns, off_s,
        0.8 * config.limits.trip_speed_rad_s,
    )  # fmt: skip


def test_no_sound_encoder_jumps_at_the_least_that_is_legal() -> None:
    rng = np.random.default_rng(7)
    parts = []
    for number in range(250):
        config = drawn_bench(rng)
        if config is not None:
            parts.append(largest_jump(config, rng, drops=number % 2 == 1))
    assert len(parts) > 100
    assert max(parts) < 1.0
    assert max(parts) > 0.8  # no more is asked than is needed


@pytest.mark.parametrize("counts", [512, 4096])
def test_a_jump_of_hardly_more_than_a_count_is_refused(counts: int) -> None:
    with pytest.raises(ValueError, match="a sound encoder would seem to jump by up to"):
        make_config(motor={"counts": counts}, limits={"encoder_jump_rad": 1.01 * TWO_PI / counts})
