"""Random and mutated input for every parser: `python -m tests.campaigns.fuzz`.

Each target is given 100,000 inputs, or as many as an option says (`--rpc 5000`; `--all 1000`). An
input is made from the seed and its number, so that any can be had again alone (`--only 4711`).
What must not happen: an exception other than the error that explains, a warning, a hang, a change
by a request that was refused. Exits with 1 if anything did.
"""

import argparse
import logging
import random
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from types import FrameType
from typing import Protocol

from tests.campaigns import seeds
from tests.campaigns.fuzzing import files, rpc, wires

INPUTS = 100_000
HANG_S = 20
EACH = 3


class Target(Protocol):
    """Something that takes one input at a time, and raises for what must not happen."""

    def __call__(self, rng: random.Random) -> bool:
        """Make an input and feed it; return whether it was taken for good."""

    def close(self) -> None:
        """Clean up."""


TARGETS: dict[str, Callable[[], Target]] = {
    "rpc": rpc.Rpc,
    "bridge": wires.Stream,
    "can": wires.Can,
    "config": files.bench_file,
    "map": files.import_map,
    "roles": files.roles_file,
    "calibration": files.calibration_file,
    "mcap": files.recording,
    "json": files.recording_json,
}


@dataclass
class Outcome:
    """How a target did: inputs, those taken for good, CPU time, what went wrong and where."""

    inputs: int = 0
    taken: int = 0
    cpu_s: float = 0.0
    slowest_s: float = 0.0
    slowest: int = -1
    wrong: Counter[str] = field(default_factory=Counter)
    first: dict[str, str] = field(default_factory=dict)


class HangError(Exception):
    """An input took too long."""


def _hang(_number: int, _frame: FrameType | None) -> None:
    raise HangError(f"no end after {HANG_S} s")


def run(name: str, inputs: int, seed: int = 1, first: int = 0) -> Outcome:
    """Feed `inputs` inputs to a target."""
    outcome = Outcome()
    target = TARGETS[name]()
    before = signal.signal(signal.SIGALRM, _hang)
    logging.getLogger("motord").setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for number in range(first, first + inputs):
                _one(target, name, seed, number, outcome)
    finally:
        signal.signal(signal.SIGALRM, before)
        logging.getLogger("motord").setLevel(logging.NOTSET)
        target.close()
    return outcome


def _one(target: Target, name: str, seed: int, number: int, outcome: Outcome) -> None:
    signal.alarm(HANG_S)
    begun_s = time.process_time()
    try:
        outcome.taken += target(random.Random(f"{name} {seed} {number}"))
    except Exception as error:  # whatever it is, it is what is looked for
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{type(error).__name__} in {last.filename}:{last.lineno}"
        outcome.wrong[where] += 1
        if where not in outcome.first:
            outcome.first[where] = f"input {number}: " + "".join(traceback.format_exc(-EACH))
    finally:
        signal.alarm(0)
    took_s = time.process_time() - begun_s
    outcome.inputs += 1
    outcome.cpu_s += took_s
    if took_s > outcome.slowest_s:
        outcome.slowest_s, outcome.slowest = took_s, number


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=seeds.first())
    parser.add_argument("--all", type=int, help="inputs for each target")
    parser.add_argument("--only", type=int, help="only the input of this number")
    for name in TARGETS:
        parser.add_argument(f"--{name}", type=int, help=f"inputs for {name}")
    options = parser.parse_args()
    named = {n: getattr(options, n) for n in TARGETS if getattr(options, n) is not None}
    counts = named or dict.fromkeys(TARGETS, INPUTS if options.all is None else options.all)
    failed = 0
    for name, count in counts.items():
        first = options.only or 0
        outcome = run(name, 1 if options.only is not None else count, options.seed, first)
        wrong = sum(outcome.wrong.values())
        failed += wrong
        print(
            f"{name:<12} {outcome.inputs:>7} inputs  {outcome.taken:>6} taken  {wrong} wrong  "
            f"{outcome.cpu_s:7.1f} s CPU  slowest {outcome.slowest_s * 1e3:.0f} ms "
            f"(input {outcome.slowest})",
            flush=True,
        )
        for where, times in outcome.wrong.most_common():
            print(f"  {times} x {where}\n    {outcome.first[where]}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
