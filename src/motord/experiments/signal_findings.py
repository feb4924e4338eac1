"""Clipped, frozen, misread signals, and torque and currents of another scale, as findings."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import copysign

import numpy as np

from motord.findings import Finding, Severity, listed
from motord.identification import CaptureError
from motord.identification.operating_points import Samples
from motord.identification.signal_condition import CLIPPED_SHARE, SignalFault

NAMES = {
    "torque_Nm": "torque",
    "encoder_count": "encoder",
    **{f"i_{phase}_A": f"current-{phase}" for phase in "abc"},
    **{f"u_{phase}_V": f"voltage-{phase}" for phase in "abc"},
}
"""Of signals, as names of findings begin."""

SHIELD = (
    "shield the encoder's lines, and let the bridge board read them twice; look for a loose plug"
)

KINDS: Mapping[str, tuple[str, float, str, str, Severity]] = {
    "clipped": (
        "% of the samples", 100 * CLIPPED_SHARE,
        "is cut off at an end of its range, so that peaks are missing and figures too small",
        "use the sensor's larger range, or smaller torques; check gain and supply of its converter",
        "serious",
    ),
    "frozen": (
        "% of the samples", 0.0,
        "keeps one value while the rotor turns, so that ripple is missing",
        "look for a loose plug or a converter that hangs; take these points again",
        "serious",
    ),
    "stuck": (
        "% of the counts", 0.0,
        "has a line that never changes, so that half of the angles never come",
        "look at the encoder's plug and lines; `motord check` reads it",
        "serious",
    ),
    "misread": (
        "% of the samples", 0.0,
        "jumps for single samples or a few in a row, which are left out: where more jump at once, "
        "angle and turns are wrong",
        SHIELD, "serious",
    ),
    "out-of-range": (
        "% of the samples", 0.0,
        "has single samples that are no count of [motor], which are left out",
        f"{SHIELD}; where it comes at the end of turns, correct counts", "warning",
    ),
}  # fmt: skip
"""Of faults: unit and limit of their share, what they mean, what to do, how severe they are."""

SCALE_PART = 0.3
"""Part by which measured and set torque may differ over all points or steps: gains of the phases,
cogging torque, zero and friction make less."""

CURRENT_PART = 0.15
"""Part by which the RMS of a sensed and of a commanded current may differ: a drive that is slow for
the speed makes less."""


def mean_torque_scale(means_Nm: Iterable[tuple[float, float]], spoiled: str) -> Iterator[Finding]:
    """Yield `torque_scale` of the set and the mean measured torque of each point."""
    pairs = list(means_Nm)
    set_Nm = sum(abs(one) for one, _ in pairs)
    if set_Nm:
        along_Nm = sum(copysign(1.0, one) * measured for one, measured in pairs)
        yield from torque_scale(along_Nm / set_Nm, spoiled)


def torque_scale(ratio: float, spoiled: str, error: float = 0.0) -> Iterator[Finding]:
    """Yield a finding if the sensor shows much more or less than the torque that was set.

    ratio: measured over set torque, known to within +- error; spoiled: which figures are as wrong.
    """
    limit = SCALE_PART + error
    if abs(ratio - 1) > limit:
        yield Finding(
            "torque-scale", 100 * (ratio - 1), 100 * limit, "%", "serious",
            f"the sensor shows {ratio:.3g} times the torque that was set: its scale or zero is "
            f"wrong, or the scale of the currents, and {spoiled} with it",
            "check [torque_sensor] gain_Nm_per_V with a weight on a lever, and the scale of the "
            "drive's currents",
        )  # fmt: skip


def beyond_rated(what: str, value: float, limit: float, unit: str) -> Finding:
    """Return the finding that a ripple or a cogging torque, `what`, is beyond the rated torque."""
    return Finding(
        "torque-scale", value, limit, unit, "serious",
        f"{what} is larger than the rated torque of [motor]: the torque is in another unit (mNm "
        "for Nm), or rated_torque_Nm is wrong",
        "check [torque_sensor] gain_Nm_per_V with a weight on a lever, or the import map",
    )  # fmt: skip


def current_scale(ratios: np.ndarray, spoiled: str) -> Iterator[Finding]:
    """Yield a finding if a phase's current is much more or less than commanded.

    ratios (3,): of `CurrentProducts`; spoiled: which figures are as wrong.
    """
    off = [n for n in range(3) if abs(ratios[n] - 1) > CURRENT_PART]
    if off:
        worst = ratios[max(off, key=lambda n: abs(ratios[n] - 1))]
        phases = ", ".join(f"{'abc'[n]} {ratios[n]:.3g}" for n in off)
        yield Finding(
            "current-scale", 100 * (worst - 1), 100 * CURRENT_PART, "%", "serious",
            f"sensed over commanded current of phase {phases} (RMS): one of them has another unit, "
            f"scale, sign or phase, or the drive did not follow, and {spoiled}",
            "check scale, sign and order of the currents in the drive's DBC file with a shunt",
        )  # fmt: skip


def signal_findings(seen: Iterable[tuple[str, Sequence[SignalFault]]]) -> tuple[Finding, ...]:
    """Return a finding for each signal and kind of fault; seen: by the labels of points."""
    found: dict[tuple[str, str], dict[str, float]] = {}
    for label, faults in seen:
        for one in faults:
            percents = found.setdefault((one.signal, one.kind), {})
            percents[label] = max(percents.get(label, 0.0), 100 * one.share)
    return tuple(_finding(*key, percents) for key, percents in found.items())


def require_reliable(samples: Samples) -> Samples:
    """Return samples without a serious fault of a signal. Raises CaptureError for others."""
    for one in samples.faults:
        _, _, meaning, action, severity = KINDS[one.kind]
        if severity == "serious":
            raise CaptureError(f"{samples.label}: {one.signal} {meaning}; {action}")
    return samples


def _finding(signal: str, kind: str, percents: Mapping[str, float]) -> Finding:
    unit, limit, meaning, action, severity = KINDS[kind]
    points = listed(list(percents))
    name, worst = f"{NAMES[signal]}-{kind}", max(percents.values())
    return Finding(name, worst, limit, unit, severity, f"{signal} {meaning}: {points}", action)
