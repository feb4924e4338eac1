"""The cost of a tick over SocketCAN, by our raw socket and by python-can.

Measured on the interface that MOTORD_TEST_CAN names; where there is none, in a virtual machine
whose processor is emulated (`tests.vm`), so that there only the ratio is meaningful.
"""

import json
import os
import sys
import tempfile
from pathlib import Path

from tests.benchmarks.figure import Figure, number
from tests.vm import cost, machine

RATIO_MAX = 0.7
TIMEOUT_S = 120.0


def figures(quick: bool) -> list[Figure]:
    """Return both costs and their ratio."""
    channel = os.environ.get("MOTORD_TEST_CAN")
    if channel:
        return _compared(cost.measure(channel), f"on {channel}")
    missing = machine.missing()
    if missing:
        return [Figure("SocketCAN", float("nan"), note=f"not measured: {missing}")]
    with tempfile.TemporaryDirectory() as name:
        out = Path(name)
        command = [sys.executable, "-m", "tests.vm.inside", "cost", "/tmp/out"]
        ended = machine.run(command, out, TIMEOUT_S, {"PYTHONDONTWRITEBYTECODE": "1"})
        if ended.code != 0:
            said = (out / "said").read_text() if (out / "said").exists() else ended.console
            raise RuntimeError(f"the machine ended with code {ended.code}: {said}")
        us = json.loads((out / "cost.json").read_text())
    return _compared(us, "in an emulated machine")


def _compared(us: dict[str, float], where: str) -> list[Figure]:
    ours, theirs = us["raw socket"], us["python-can"]
    note = f"{number(ours)} us to {number(theirs)} us of processor time {where}"
    what = "SocketCAN: a tick's read and write, raw socket to python-can"
    return [Figure(what, ours / theirs, "", RATIO_MAX, "at most", note)]
