"""What is questionable about ripple over the mesh, each with its meaning and what to do."""

from collections.abc import Iterator, Sequence
from math import hypot

from motord.experiments.signal_findings import signal_findings
from motord.findings import Finding, listed
from motord.identification.point_ripple import PointRipple

SURE = 3.0
"""Standard errors beyond which ripple is said to have grown."""


def findings(ripples: Sequence[PointRipple]) -> tuple[Finding, ...]:
    """Return what is questionable about the ripple of the points."""
    faults = signal_findings((one.label, one.faults) for one in ripples)
    return (*_one_turn(ripples), *_worse(ripples), *faults)


def _one_turn(ripples: Sequence[PointRipple]) -> Iterator[Finding]:
    alone = [one for one in ripples if one.turns < 2]
    if alone:
        yield Finding(
            "one-turn", 1, 2, "turns", "warning",
            f"{listed([one.label for one in alone])}: one whole turn does not show its noise, "
            "which is part of the RMS error then; how far that is off is not known from one turn",
            "take more turns at each point",
        )  # fmt: skip


def _worse(ripples: Sequence[PointRipple]) -> Iterator[Finding]:
    """Yield a finding where compensation makes the torque rougher, beyond noise."""
    before = {(one.torque_Nm, one.speed_Hz): one for one in ripples if one.compensate == 0}
    grown = []
    for one in ripples:
        plain = before.get((one.torque_Nm, one.speed_Hz))
        if plain is None or one.compensate == 0:
            continue
        noise = hypot(plain.stderr_percent or 0.0, one.stderr_percent or 0.0)
        if one.rms_percent - plain.rms_percent > SURE * noise:
            grown.append((one.rms_percent - plain.rms_percent, SURE * noise, one))
    if grown:
        worst, limit, _ = max(grown, key=lambda each: each[0])
        yield Finding(
            "rougher-with-compensation", worst, limit, "% of rated", "serious",
            f"{listed([one.label for *_, one in grown])}: the torque is rougher with compensation "
            "than without: the calibration is not of this motor, bench or encoder zero",
            "check which calibration is in force; align and calibrate again",
        )  # fmt: skip
