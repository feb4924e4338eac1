"""Clipped and frozen signals as findings."""

from collections.abc import Iterable, Mapping, Sequence

from motord.findings import Finding, listed
from motord.identification.signal_condition import CLIPPED_SHARE, SignalFault

NAMES = {
    "torque_Nm": "torque",
    "encoder_count": "encoder",
    **{f"i_{phase}_A": f"current-{phase}" for phase in "abc"},
    **{f"u_{phase}_V": f"voltage-{phase}" for phase in "abc"},
}
"""Of signals, as names of findings begin."""

KINDS = {
    "clipped": (
        "% of the samples", 100 * CLIPPED_SHARE,
        "is cut off at an end of its range, so that peaks are missing and figures too small",
        "use the sensor's larger range, or smaller torques; check gain and supply of its converter",
    ),
    "frozen": (
        "% of the samples", 0.0,
        "keeps one value while the rotor turns, so that ripple is missing",
        "look for a loose plug or a converter that hangs; take these points again",
    ),
    "stuck": (
        "% of the counts", 0.0,
        "has a line that never changes, so that half of the angles never come",
        "look at the encoder's plug and lines; `motord check` reads it",
    ),
}  # fmt: skip
"""Of faults: unit and limit of their share, what they mean, what to do."""


def signal_findings(seen: Iterable[tuple[str, Sequence[SignalFault]]]) -> tuple[Finding, ...]:
    """Return a finding for each signal and kind of fault; seen: by the labels of points."""
    found: dict[tuple[str, str], dict[str, float]] = {}
    for label, faults in seen:
        for one in faults:
            found.setdefault((one.signal, one.kind), {})[label] = 100 * one.share
    return tuple(_finding(*key, percents) for key, percents in found.items())


def _finding(signal: str, kind: str, percents: Mapping[str, float]) -> Finding:
    unit, limit, meaning, action = KINDS[kind]
    points = listed(list(percents))
    name, worst = f"{NAMES[signal]}-{kind}", max(percents.values())
    return Finding(name, worst, limit, unit, "serious", f"{signal} {meaning}: {points}", action)
