"""What campaigns print of a bench that departs: which intervals hold the truth, what is found."""

import sys
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from motord.findings import Finding
from motord.identification import IdentifyError

Given = TypeVar("Given")

HELD = 0.95
SLACK = 2.5
"""Standard deviations of a share over the trials by which it may miss what is expected of it."""


@dataclass(frozen=True)
class Trial:
    """Which figures' intervals hold the truth, and the findings."""

    held: Mapping[str, bool]
    findings: Iterable[Finding] = ()


def attempted(trial: Callable[[Given], Trial], given: Given) -> Trial | None:
    """Return what a trial shows, None where the analysis refuses it."""
    try:
        return trial(given)
    except IdentifyError:
        return None


def judge(
    name: str,
    trials: Sequence[Trial | None],
    *,
    named: str = "",
    power: float = 1.0,
    lost: Collection[str] = (),
    refused: bool = False,
) -> bool:
    """Print what the trials of a departure show, None of one that was refused.

    Return whether the intervals of each figure hold the truth but of those that are `lost`, all
    trials are `named`, or as many as a test of that power finds, and none is refused but where
    `refused` says so.
    """
    taken = [one for one in trials if one is not None]
    left_out = len(trials) - len(taken)
    held = {
        key: float(np.mean([one.held[key] for one in taken]))
        for key in (taken[0].held if taken else ())
    }
    least = _least(HELD, len(taken))
    names = Counter(
        key for one in taken for key in {f"{each.name}, {each.severity}" for each in one.findings}
    )
    said = sum(any(each.name == named for each in one.findings) for one in taken)
    missed = [key for key, part in held.items() if part < least and key not in lost]
    failures = [f"{key} NOT KEPT" for key in missed]
    unnamed = bool(named) and said < _least(power, len(taken)) * len(taken)
    failures += [f"{named} in {said} of {len(taken)} NOT KEPT"] * unnamed
    failures += ["refused NOT KEPT"] * (not taken or (left_out > 0 and not refused))
    shares = ", ".join(f"{key} {part:.0%}" for key, part in held.items())
    found = [f"{key}: {number}" for key, number in sorted(names.items())]
    counts = "; ".join([*found, f"refused: {left_out}"])
    print(f"{name}: held {shares or 'none'}; of {len(trials)}: {counts}", *failures, flush=True)
    return not failures


def _least(share: float, trials: int) -> float:
    """Return the least share that so many trials have of what is expected of them."""
    return float(share - SLACK * np.sqrt(share * (1 - share) / max(trials, 1)))


def run(main: Callable[..., int], departures: Callable[..., int]) -> int:
    """Run what the command line asks for, `[departures] [COUNT]`; return the exit code."""
    asked = sys.argv[1:]
    if asked[:1] == ["departures"]:
        return departures(*map(int, asked[1:]))
    return main(*map(int, asked))
