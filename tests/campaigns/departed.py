"""What campaigns print of a bench that departs: which intervals hold the truth, what is found."""

import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from motord.findings import Finding


@dataclass(frozen=True)
class Trial:
    """Which figures' intervals hold the truth, and the findings."""

    held: Mapping[str, bool]
    findings: Iterable[Finding] = ()


def judge(name: str, trials: list[Trial | None], least: float = 0.9, named: str = "") -> bool:
    """Print what the trials of a departure show, None of one that was refused.

    Return whether intervals hold the truth in `least` of all figures, and all are `named`.
    """
    taken = [one for one in trials if one is not None]
    if not taken:
        print(f"{name}: all {len(trials)} refused NOT KEPT", flush=True)
        return False
    held = {key: float(np.mean([one.held[key] for one in taken])) for key in taken[0].held}
    names = Counter(
        key for one in taken for key in {f"{each.name}, {each.severity}" for each in one.findings}
    )
    refused = len(trials) - len(taken)
    found = [f"{key}: {number}" for key, number in sorted(names.items())]
    mean = float(np.mean(list(held.values())))
    said = sum(any(each.name == named for each in one.findings) for one in taken)
    kept = mean >= least and (not named or said == len(taken))
    print(
        f"{name}: {mean:.0%} held ({', '.join(f'{key} {part:.0%}' for key, part in held.items())})"
        f"; of {len(trials)}: {'; '.join([*found, f'refused: {refused}'])}",
        *("NOT KEPT",) * (not kept), flush=True,
    )  # fmt: skip
    return kept


def run(main: Callable[..., int], departures: Callable[..., int]) -> int:
    """Run what the command line asks for, `[departures] [COUNT]`; return the exit code."""
    asked = sys.argv[1:]
    if asked[:1] == ["departures"]:
        return departures(*map(int, asked[1:]))
    return main(*map(int, asked))
