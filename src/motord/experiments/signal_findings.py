"""Clipped and frozen signals as findings."""

from collections.abc import Iterable, Sequence

from motord.findings import Finding, listed
from motord.identification.signal_condition import SignalFault

MEANINGS = {
    "clipped": (
        "is cut off at an end of its range, so that peaks are missing and figures too small",
        "use the sensor's larger range, or smaller torques; check gain and supply of its converter",
    ),
    "stuck": (
        "has a line that never changes, so that half of the angles never come",
        "look at the encoder's plug and lines; `motord check` reads it",
    ),
    "frozen": (
        "keeps one value while the rotor turns, so that ripple is missing",
        "look for a loose plug or a converter that hangs; take these points again",
    ),
}


def signal_findings(seen: Iterable[tuple[str, Sequence[SignalFault]]]) -> tuple[Finding, ...]:
    """Return a finding for each signal and kind of fault; seen: by the labels of points."""
    found: dict[tuple[str, str], dict[str, float]] = {}
    for label, faults in seen:
        for one in faults:
            found.setdefault((one.signal, one.kind), {})[label] = 100 * one.share
    return tuple(
        Finding(
            f"{signal.split('_')[0] if signal == 'torque_Nm' else signal}-{kind}",
            max(percents.values()), 0, "% of the samples", "serious",
            f"{signal} {MEANINGS[kind][0]}: {listed(list(percents))}", MEANINGS[kind][1],
        )
        for (signal, kind), percents in found.items()
    )  # fmt: skip
