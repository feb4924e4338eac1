"""A recording read by the reference reader of JavaScript, seeking and streaming: equal content."""

import hashlib
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from motord.config import load
from motord.experiments.plans import build
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.schema import TICK
from motord.virtual import VirtualBench
from motord.virtual.plan import run_plan
from motord.wire.ticks.blocks import BlockCodec

NODE = Path(__file__).resolve().parents[1] / "node"

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(
        shutil.which("node") is None, reason="needs node: apt-get install nodejs npm"
    ),
    pytest.mark.skipif(
        not (NODE / "node_modules").exists(), reason="needs packages: npm ci --prefix tests/node"
    ),
]


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_the_reference_reader_finds_the_same(tmp_path: Path, compression: str) -> None:
    path = tmp_path / "run.mcap"
    config = load()
    mesh = {
        "torques_Nm": [2.0], "speeds_Hz": [0.9], "turns": 2, "settle_s": 0.2, "gain_steps": [],
    }  # fmt: skip
    with RunWriter(path, {"bench": "sim"}, compression=compression) as writer:
        for point in run_plan(
            VirtualBench(config),
            build("calibrate", config, mesh),
            lambda ticks, truth: (writer.ticks(ticks), writer.truth(truth)),
        ):
            writer.operating_point(point["t_end_ns"], point)
    done = subprocess.run(
        ["node", str(NODE / "read.mjs"), str(path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    run = open_run(path)
    ticks = run.ticks()
    digest = hashlib.sha256(BlockCodec(TICK).encode(ticks).tobytes()).hexdigest()
    sums = {
        name: str(sum(ticks[name].tolist())) for name in ("tick", "t_ns", "encoder_count", "state")
    }
    micro = np.floor(ticks["torque_Nm"].astype(float) * 1e6)
    sums["torque_uNm"] = str(int(micro.sum()))
    points = len(run.operating_points())
    assert points >= 1
    counts = {"/tick": ticks.size, "/truth": ticks.size, "/operating_point": points}
    for way in ("seeking", "streaming"):
        assert found[way]["counts"] == counts, way
        assert found[way]["ticks"] == digest, way
        assert found[way]["sums"] == sums, way
        assert found[way]["json"] == run.operating_points(), way
    assert found["seeking"]["metadata"] == ["motord", "motord.end"]
    assert found["seeking"]["statistics"] == sum(counts.values())
    assert found["streaming"]["done"]
