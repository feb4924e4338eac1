"""Quick calibrations on the wire: `python -m tests.campaigns.quick_wire [SEEDS]`.

For each seed the emulated bench of config/ runs in real time and is calibrated by `calibrate` with
10 s, and with 30 s. The true torque error that the calibration leaves is taken at each point of the
mesh on the same rig in virtual time. Exits with 1 if a bound is not kept.
"""

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from motord.config import load
from motord.experiments.calibration.command import estimate
from motord.experiments.subject import Recordings
from motord.recording.reader import open_run
from motord.rig.truth import load as load_truth
from motord.schema import State
from tests.campaigns import seeds
from tests.campaigns.quick import LEFT_PERCENT, PARTS, left_percent
from tests.system.daemons import daemon, emulator, runtime_of, wait_for
from tests.unit.emulate.benches import write_bench

SEEDS = 3


@dataclass(frozen=True)
class Trial:
    """bench_s: enabled; left_percent (points,) of the mesh; alpha: relative errors, percent (3,);
    missed: ticks that the loop skipped on the bench; findings of the analysis."""

    bench_s: float
    left_percent: np.ndarray
    alpha_percent: np.ndarray
    missed: int
    findings: tuple[str, ...]

    def __str__(self) -> str:
        errors = ", ".join(f"{error:+.3f}" for error in self.alpha_percent)
        line = (
            f"{self.bench_s:.2f} s, {self.left_percent.max():.3f} % of rated left at the worst of "
            f"{self.left_percent.size} points; alpha off by {errors} %; {self.missed} ticks missed"
        )
        return line + (f"; findings: {', '.join(self.findings)}" if self.findings else "")


def trial(folder: Path, seed: int, limit_s: float) -> Trial:
    """Calibrate the emulated bench of a seed, and take what that leaves."""
    bench = write_bench(folder, {"seed = 1": f"seed = {seed}"})
    with (
        runtime_of(folder),
        emulator(folder, bench, folder / "truth.mcap"),
        daemon(folder, bench) as running,
    ):
        with running.connect() as client, client.lease("campaign") as lease:
            wait_for(client, lambda state: not state.trips, "samples of all devices")
            for _ in lease.run_plan("calibrate", {"time_limit_s": limit_s}):
                pass
        assert running.end() == 0, running.said()
    [path] = sorted((folder / "runs").glob("*-calibrate-*.mcap"))
    run = open_run(path)
    enabled = run.ticks(("t_ns", "state", "missed"))
    enabled = enabled[enabled["state"] == State.ENABLED]
    found = estimate(Recordings((run,)))
    truth = load_truth()
    alpha = np.array(truth.inverter.alpha)
    alpha /= np.cbrt(alpha.prod())
    return Trial(
        bench_s=1e-9 * float(enabled["t_ns"][-1] - enabled["t_ns"][0]),
        left_percent=left_percent(load(), truth, seed, found.calibration),
        alpha_percent=100 * (np.array(found.calibration.alpha) / alpha - 1),
        missed=int(enabled["missed"][-1] - enabled["missed"][0]),
        findings=tuple(one.name for one in found.calibration.serious_findings),
    )


def main() -> int:
    """Run the trials, print what they show, return the exit code."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS
    kept = True
    for part, bound_percent in LEFT_PERCENT.items():
        limit_s = PARTS[part]["time_limit_s"]
        for seed in seeds.several(count):
            with tempfile.TemporaryDirectory() as folder:
                one = trial(Path(folder), seed, limit_s)
            print(f"{part}, seed {seed}: {one}", flush=True)
            worst = float(one.left_percent.max())
            kept = kept and worst <= bound_percent and one.bench_s <= limit_s
    return int(not kept)


if __name__ == "__main__":
    sys.exit(main())
