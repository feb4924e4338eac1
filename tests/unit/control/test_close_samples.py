"""A bridge that samples more often than the loop reads: some samples are close together.

Of a coarse encoder they make a speed that is far off, by which the next sample seemed to jump, and
the rotor to be beyond its limit.
"""

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from motord.config import Config
from motord.config.bounds import rounded_up
from motord.config.rules.encoder import least_jump_rad
from motord.config.timing import JUMP_MAX_RAD, SAMPLE_TIME_S
from motord.control.observer import TWO_PI, observe
from motord.control.types import MEMORY
from motord.jit import jit
from tests.support.properties import examples
from tests.unit.control.bench import Bench, make_config

FOUND = (
    (189, 293, 859, 762.6, 141.1, 0.13),
    (256, 249, 617, 685.0, 30.6, 0.0751),
    (512, 170, 300, 622.4, 10.5, 0.0298),
)
"""counts, [loop] rate_Hz, [bridge] rate_Hz, observer_bandwidth_Hz, trip_speed_rad_s,
encoder_jump_rad: the first two tripped, the last seemed beyond its speed limit and stayed OFF."""


def config_of(
    counts: int,
    loop_Hz: int,
    bridge_Hz: int,
    bandwidth_Hz: float,
    trip_rad_s: float,
    jump_rad: float,
) -> Config:
    sections: dict[str, Any] = {
        "loop": {"rate_Hz": loop_Hz, "observer_bandwidth_Hz": bandwidth_Hz},
        "bridge": {"rate_Hz": bridge_Hz, "stale_after_s": 0.1},
        "inverter": {"stale_after_s": 0.1, "timeout_s": 0.1},
        "motor": {"counts": counts},
        "limits": {"trip_speed_rad_s": trip_rad_s, "encoder_jump_rad": jump_rad},
    }
    return make_config(**sections)


@pytest.mark.parametrize("found", FOUND)
def test_a_speed_by_two_close_samples_is_reckoned_with(
    found: tuple[int, int, int, float, float, float],
) -> None:
    """It is refused with what helps: a higher limit, or an observer that takes several samples."""
    with pytest.raises(ValidationError, match="too low for an encoder") as said:
        config_of(*found)
    assert "lower [loop] observer_bandwidth_Hz" in str(said.value)
    counts, loop_Hz, bridge_Hz, _, trip_rad_s, jump_rad = found
    config_of(counts, loop_Hz, bridge_Hz, 15.0, trip_rad_s, max(jump_rad, 0.06))


@jit
def observe_all(
    parameters: np.ndarray, memory: np.ndarray, t_ns: np.ndarray, counts: np.ndarray, first: float
) -> tuple[int, float]:
    """Return the implausible samples and the greatest speed seen, of all but the first 21.

    parameters, memory: one record each; first: speed that is known at the first sample. From
    Python each sample takes ten times as long.
    """
    p, m = parameters[0], memory[0]
    implausible, fastest_rad_s = 0, 0.0
    for index in range(t_ns.size):
        observe(p, m, t_ns[index], counts[index])
        if index == 0:
            m.speed_rad_s = first
        if index > 20:
            implausible += int(m.sound == 0)
            fastest_rad_s = max(fastest_rad_s, abs(m.speed_rad_s))
    return implausible, fastest_rad_s


def seen(config: Config, draw: np.random.Generator, speed_rad_s: float) -> tuple[int, float]:
    """Return the implausible samples of a rotor at a constant speed, and the greatest speed seen.

    The loop reads the newest sample; one in ten is lost; the times of some are off.
    """
    times = draw.random() + np.arange(1500) * config.sample_rate_Hz / config.loop.rate_Hz
    newest, start_rad = np.unique(np.floor(times)), draw.uniform(0.0, TWO_PI)
    t_s = newest[draw.random(len(newest)) > 0.1] / config.sample_rate_Hz
    counts = config.motor.counts
    count = np.floor((start_rad + speed_rad_s * t_s) / TWO_PI * counts + 0.5) % counts
    off_s = SAMPLE_TIME_S * draw.integers(2, size=t_s.size)
    t_ns = np.rint((1.0 + t_s + off_s) * 1e9).astype(np.int64)
    memory = np.zeros(1, MEMORY)
    return observe_all(Bench(config).parameters, memory, t_ns, count.astype(np.int64), speed_rad_s)


@given(
    loop_Hz=st.integers(100, 1000),
    ratio=st.floats(0.5, 8.0),
    bandwidth_Hz=st.sampled_from([15.0, 30.0, 100.0, 300.0, 1000.0]),
    counts=st.sampled_from([64, 189, 512, 4096]),
    part=st.sampled_from([0.01, 0.1, 0.8]),
    seed=st.integers(0, 2**32 - 1),
)
@example(loop_Hz=1000, ratio=1.9, bandwidth_Hz=805.0, counts=512, part=0.8, seed=1)
@settings(max_examples=examples(200), deadline=None)
def test_close_samples_are_no_jump_and_no_over_speed(
    loop_Hz: int, ratio: float, bandwidth_Hz: float, counts: int, part: float, seed: int
) -> None:
    """At the least limits that are legal, at each speed that may be set.

    The example is beyond its speed limit if times of samples that are off are left out of it: by
    3 % if everywhere, by 12 % if only in the part that grows with the speed.
    """
    bridge_Hz = max(round(loop_Hz * ratio), 100)
    rates = counts, loop_Hz, bridge_Hz, bandwidth_Hz
    try:
        trip_rad_s = least_trip_rad_s(*rates)
        loose = config_of(*rates, trip_rad_s, JUMP_MAX_RAD)
        config = config_of(*rates, trip_rad_s, least_jump_rad(loose))
    except ValidationError:  # no limit is legal
        assume(False)
    implausible, fastest_rad_s = seen(config, np.random.default_rng(seed), part * trip_rad_s)
    assert implausible == 0
    assert fastest_rad_s <= trip_rad_s


def least_trip_rad_s(counts: int, loop_Hz: int, bridge_Hz: int, bandwidth_Hz: float) -> float:
    """Return the least speed limit that is legal, as the refusal of a lower one names it."""
    try:
        config_of(counts, loop_Hz, bridge_Hz, bandwidth_Hz, 1e-4, JUMP_MAX_RAD)
    except ValidationError as error:
        bound = error.errors()[0]["msg"].partition("make it at least ")[2].partition(",")[0]
        assume(bound != "")
        return rounded_up(float(bound))
    raise AssertionError("no speed limit is too low")
