"""Plan after plan in one process takes no more memory than the first."""

import gc
import tracemalloc

from motord.config import load, packaged
from motord.plans import build
from motord.virtual import VirtualBench
from tests.campaigns.memory import PLAN, record_plan

MOST_BYTES = 20_000
"""Less than a hundred ticks, or what a point's account takes twenty times over."""


def test_a_plan_leaves_nothing_behind(tmp_path):
    config = load(packaged("sim.toml"))
    bench = VirtualBench(config)
    plan = build("verify", config, {**PLAN, "torques_Nm": [1.0], "speeds_Hz": [1.0]})
    held = []
    tracemalloc.start()
    try:
        for number in range(5):
            ticks = record_plan(bench, plan, tmp_path / f"{number}.mcap")
            assert ticks > 2 * config.loop.rate_Hz
            gc.collect()
            held.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    grown = [after - held[1] for after in held[2:]]
    assert max(grown) < MOST_BYTES, grown
