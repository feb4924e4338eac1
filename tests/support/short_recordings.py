"""Many short recordings of driven rotors, by little computing: one in virtual time, then its ticks
again and again with noise of the torque sensor that no other has."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from motord.config import Config, packaged
from motord.experiments.plans import build
from motord.recording.metadata import describe
from motord.recording.writer import RunWriter
from motord.rig.truth import RigTruth
from motord.virtual import VirtualBench
from motord.virtual.plan import run_plan

SETTINGS = {"speeds_Hz": [1.0], "settle_s": 0.2, "spin_up": 1.0}
NOISE_NM = 0.02
DAY_NS = 86_400_000_000_000


@dataclass(frozen=True)
class ShortRecording:
    """A run of the plan cogging: ticks (n,), and its operating points."""

    config: Config
    ticks: np.ndarray
    points: tuple[dict[str, object], ...]

    @classmethod
    def of(
        cls, config: Config, truth: RigTruth | None = None, turns: int = 3, seed: int = 4
    ) -> "ShortRecording":
        """Return one from virtual time, of a rig of the bench."""
        bench, blocks = VirtualBench(config, truth, seed=seed), []
        points = tuple(
            run_plan(
                bench,
                build("cogging", config, {**SETTINGS, "turns": turns}),
                lambda ticks, truth: blocks.append(ticks.copy()),
            )
        )
        return cls(config, np.concatenate(blocks), points)

    def write(self, path: Path, number: int = 0) -> Path:
        """Write it with the noise of `number`, so many days later, of the motor of that number."""
        ticks = self.ticks.copy()
        noise_Nm = np.random.default_rng([7, number]).normal(0.0, NOISE_NM, ticks.size)
        ticks["torque_Nm"] += noise_Nm.astype(ticks["torque_Nm"].dtype)
        later_ns = number * DAY_NS
        ticks["t_ns"] += later_ns
        motor = self.config.motor.model_copy(update={"serial": f"SN{number:04d}"})
        config = self.config.model_copy(update={"motor": motor})
        with RunWriter(path, describe(config, packaged("sim.toml").read_text())) as writer:
            writer.ticks(ticks)
            for point in self._points(later_ns):
                writer.operating_point(int(point["t_end_ns"]), point)
        return path

    def _points(self, later_ns: int) -> Iterator[dict[str, object]]:
        for point in self.points:
            times = {name: point[name] + later_ns for name in ("t_start_ns", "t_end_ns")}
            yield {**point, **times}
