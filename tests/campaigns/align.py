"""Phase order, encoder direction and zero on rigs where all of them are anything.

`python -m tests.campaigns.align [RIGS]` prints how far off the offset is and exits 1 if a bound is
not kept.
"""

import sys
from dataclasses import dataclass

import numpy as np

from motord.config import Config, load
from motord.experiments.alignment.estimate import align
from motord.experiments.alignment.rests import REQUIRED
from motord.experiments.alignment.result import Alignment
from motord.experiments.plans import build
from motord.rig.truth import RigTruth
from motord.rig.truth import load as load_truth
from motord.virtual import VirtualBench
from motord.virtual.plan import run_plan
from tests.campaigns import seeds


@dataclass(frozen=True)
class Case:
    """What is true of a rig, and which way it stands at the start."""

    offset_rad: float
    direction: int
    phase_order: str
    standing_rad: float
    seed: int

    def truth(self, **changes: dict[str, object]) -> RigTruth:
        """Return the packaged rig, misaligned."""
        truth = load_truth().model_dump()
        truth["encoder"] |= {"offset_rad": self.offset_rad, "direction": self.direction}
        truth["inverter"] |= {"phase_order": self.phase_order}
        truth["rotor"] |= {"angle_rad": self.standing_rad}
        for table, values in changes.items():
            truth[table] |= values
        return RigTruth.model_validate(truth)

    def error_points(self, found: Alignment, config: Config) -> float:
        """Return how far the offset is off, in encoder points."""
        turn_rad = 2 * np.pi / config.motor.pole_pairs
        off_rad = (found.offset_rad - self.offset_rad + turn_rad / 2) % turn_rad - turn_rad / 2
        return float(off_rad * config.motor.counts / (2 * np.pi))


def random_case(seed: int) -> Case:
    """Return a case drawn from a seed."""
    draw = np.random.default_rng(seed)
    return Case(
        offset_rad=float(draw.uniform(0, 2 * np.pi)),
        direction=int(draw.choice([1, -1])),
        phase_order=str(draw.choice(["abc", "acb"])),
        standing_rad=float(draw.uniform(0, 2 * np.pi)),
        seed=seed,
    )


def sweeps_of(config: Config, truth: RigTruth, seed: int, **settings: object) -> list[np.ndarray]:
    """Return the ticks of every sweep of the plan `align` on a rig."""
    bench = VirtualBench(config, truth, seed=seed)
    plan = build("align", config, settings)
    blocks: list[np.ndarray] = []
    points = run_plan(bench, plan, lambda ticks, truth: blocks.append(ticks))
    ticks = np.concatenate(blocks)
    chosen = [ticks["plan_point"] == point["index"] for point in points]
    return [ticks[list(REQUIRED)][rows] for rows in chosen]


def aligned(config: Config, case: Case, **settings: object) -> Alignment:
    """Return what is found on the rig of a case."""
    return align(sweeps_of(config, case.truth(), case.seed, **settings), config.motor)


def main(rigs: int) -> int:
    """Print the figures of so many rigs; return 1 if a bound is not kept."""
    config, wrong = load(), 0
    points_rad = 2 * np.pi / config.motor.counts
    off, stated, friction = [], [], []
    for seed in seeds.several(rigs, 0):
        case = random_case(seed)
        found = aligned(config, case)
        right = (found.phase_order, found.direction) == (case.phase_order, case.direction)
        wrong += not right
        off.append(case.error_points(found, config))
        stated.append(found.offset_stderr_rad / points_rad)
        friction.append(found.friction_rad / points_rad)
    error, bound = np.abs(off), 0.5 + np.array(friction)
    inside = error < 1.96 * np.array(stated)
    print(f"{rigs} rigs: phase order or direction wrong: {wrong}")
    print(
        f"offset off by {np.sqrt(np.mean(error**2)):.3f} encoder points RMS, "
        f"{error.max():.3f} at most, mean {np.mean(off):+.3f}; stated {np.mean(stated):.3f}, "
        f"95 % interval holds {100 * inside.mean():.0f} %; friction {np.mean(friction):.2f}"
    )
    return int(wrong > 0 or bool((error > bound).any()))


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 50))
