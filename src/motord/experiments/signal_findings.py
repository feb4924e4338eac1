"""Clipped and frozen signals, and a torque of another scale, as findings."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

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

SCALE_PART = 0.3
"""Part by which measured and set torque may differ over all points or steps: gains of the phases,
cogging torque, zero and friction make less."""


def torque_scale(ratio: float, spoiled: str) -> Iterator[Finding]:
    """Yield a finding if the sensor shows much more or less than the torque that was set.

    ratio: measured over set torque; spoiled: which figures are as wrong.
    """
    if abs(ratio - 1) > SCALE_PART:
        yield Finding(
            "torque-scale", 100 * (ratio - 1), 100 * SCALE_PART, "%", "serious",
            f"the sensor shows {ratio:.3g} times the torque that was set: its scale or zero is "
            f"wrong, or the scale of the currents, and {spoiled} with it",
            "check [torque_sensor] gain_Nm_per_V with a weight on a lever, and the scale of the "
            "drive's currents",
        )  # fmt: skip


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
