"""What the wires cost the loop a tick: CAN and serial bridge, read and written through the drivers.

    python -m tests.benchmarks.bench_wire [--json FILE] [--ticks N]

Both peers run in the same thread and speak once before each tick: two feedback frames and the
command's echo on CAN, a sample and a status on a pseudo-terminal. Figures are of the driver's calls
alone; the sum compares with the limit below.
"""

import argparse
import gc
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from motord.hal.bridge_serial import SerialBridge
from motord.hal.inverter_can import CanInverter
from motord.wire import frames
from tests.contract.benches import new_command, new_feedback
from tests.contract.peers import Board, Drive, bench, can_config

SUM_P50_LIMIT_us = 300.0
TICKS = 3000


class Rig:
    """Both drivers, and peers that speak when told."""

    def __init__(self, interface: str) -> None:
        can = can_config(interface)
        self.drive, self.board = Drive(can), Board()
        setup = bench(can, self.board.port)
        self.inverter, self.bridge = CanInverter(setup), SerialBridge(setup)
        self.inverter.open()
        self.bridge.open()
        for peer in (self.drive, self.board):
            peer.silent = True
            peer.stop()

    def speak(self) -> None:
        self.drive.hear()
        self.board.hear()
        self.drive.speak()
        self.board.speak()

    def close(self) -> None:
        self.inverter.close()
        self.bridge.close()
        self.drive.release()
        self.board.release()


def parts(rig: Rig) -> dict[str, Callable[[], None]]:
    """Return the calls of a tick, in their order."""
    feedback, command = new_feedback(), new_command((1.0, -2.0, 1.0), 1)
    return {
        "bridge read": lambda: rig.bridge.read(time.time_ns(), feedback),
        "inverter read": lambda: rig.inverter.read(time.time_ns(), feedback),
        "inverter write": lambda: rig.inverter.write(command),
        "bridge write": lambda: rig.bridge.write(command),
    }


def measure(interface: str, ticks: int) -> dict[str, dict[str, float]]:
    """Return the quantiles of each part and of their sum, in us."""
    rig = Rig(interface)
    calls = parts(rig)
    costs_us = np.zeros((ticks, len(calls)))
    gc.disable()
    for tick in range(ticks):
        rig.speak()
        for place, call in enumerate(calls.values()):
            begun_ns = time.perf_counter_ns()
            call()
            costs_us[tick, place] = (time.perf_counter_ns() - begun_ns) * 1e-3
    gc.enable()
    rig.close()
    columns = dict(zip(calls, costs_us.T, strict=True)) | {"sum": costs_us.sum(axis=1)}
    return {
        name: {f"p{q}_us": float(np.percentile(column, q)) for q in (10, 50, 99)}
        for name, column in columns.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--json", type=Path, help="write the results to this file")
    parser.add_argument("--ticks", type=int, default=TICKS)
    options = parser.parse_args()
    results = {name: measure(name, options.ticks) for name in ("udp_multicast", "virtual")}
    lines = [f"bytes of a sample on the wire: {len(frames.encode(frames.Sample(0, 0, 0, 0), 0))}"]
    for interface, table in results.items():
        lines += [f"a tick over {interface} and a pseudo-terminal"]
        for name, figures in table.items():
            lines += [f"  {name:16}" + "".join(f"{k[:-3]:>6} {v:8.1f}" for k, v in figures.items())]
        table["sum"]["p50_to_limit"] = table["sum"]["p50_us"] / SUM_P50_LIMIT_us
        lines += [
            f"  p50 of the sum to {SUM_P50_LIMIT_us:g} us: {table['sum']['p50_to_limit']:.2f}"
        ]
    sys.stdout.write("\n".join(lines) + "\n")
    if options.json:
        options.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
