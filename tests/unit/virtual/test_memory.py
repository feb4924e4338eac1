"""Plan after plan in one process takes no more memory than the first."""

import gc
import json
import subprocess
import sys
import tracemalloc
from pathlib import Path

from motord.config import load, packaged
from motord.experiments.plans import build
from motord.virtual import VirtualBench
from tests.campaigns.memory import PLAN, record_plan

MOST_BYTES = 20_000
"""Less than a hundred ticks, or what a point's account takes twenty times over."""
ROOT = Path(__file__).parents[3]


def held_bytes(folder: Path) -> list[int]:
    """Return what is held after each of five plans, recorded into `folder`."""
    config = load(packaged("sim.toml"))
    bench = VirtualBench(config)
    plan = build("verify", config, {**PLAN, "torques_Nm": [1.0], "speeds_Hz": [1.0]})
    held = []
    tracemalloc.start()
    for number in range(5):
        ticks = record_plan(bench, plan, folder / f"{number}.mcap")
        assert ticks > 2 * config.loop.rate_Hz
        gc.collect()
        held.append(tracemalloc.get_traced_memory()[0])
    return held


def test_a_plan_leaves_nothing_behind(tmp_path):
    """In a process of its own, where nothing else is measured or takes notes."""
    done = subprocess.run(
        [sys.executable, "-m", __name__, tmp_path], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    held = json.loads(done.stdout)
    grown = [after - held[1] for after in held[2:]]
    assert max(grown) < MOST_BYTES, grown


if __name__ == "__main__":
    sys.stdout.write(json.dumps(held_bytes(Path(sys.argv[1]))))
