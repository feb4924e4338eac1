"""What is questionable about ripple over the mesh, each with its meaning and what to do."""

from collections.abc import Iterator, Sequence
from math import hypot, inf

from motord.experiments.signal_findings import beyond_rated, mean_torque_scale, signal_findings
from motord.findings import Finding, listed
from motord.identification.point_ripple import AsynchronousLine, PointRipple
from motord.identification.signal_condition import is_stuck
from motord.intervals import SERIOUS_BIAS, coverage_factor

LINE_PERCENT = 0.1
"""Amplitude, percent of rated, of a line that is not locked to the rotor from which on it is said:
what rings in a torque sensor that is compensated is below."""

AS_LARGE = 1 - 0.5**0.5
"""Part of the RMS error by which a line makes it larger that is as large as the ripple."""

ALIKE = 0.01
"""Part by which frequencies, or orders, of one line differ from point to point."""

COVERAGE_FACTOR = 3.0
"""Standard errors by which ripple must have grown to be a finding."""

MOST_PERCENT = 100.0
"""RMS error, percent of rated, that no motor has."""

HIDDEN_PERCENT = 0.1
"""Half-width of an RMS error, percent of rated, from which on noise that exceeds it matters."""


def asynchronous_line(
    ripples: Sequence[PointRipple], consequence: str = "the intervals hold that"
) -> Iterator[Finding]:
    """Yield a finding of lines that are not locked to the rotor; a note where none matters.

    And a note of points where they were not looked for. consequence: what the results make of what
    the lines change.
    """
    stuck = [one.label for one in ripples if is_stuck(one.faults)]
    if stuck:
        yield Finding(
            "asynchronous-lines-unsearched", len(stuck), 0, "points", "note",
            f"{listed(stuck)}: the torque was not searched for lines that are not locked to the "
            "rotor, so that the intervals do not hold them: angles of a stuck encoder make some",
            "mend the encoder, record these points again",
        )  # fmt: skip
    humming = [one for one in ripples if one.asynchronous_percent > LINE_PERCENT]
    if humming:
        most = max(humming, key=lambda one: one.asynchronous_percent)
        worst = max(humming, key=lambda one: one.leakage_percent)
        leaking = [one for one in humming if one.leakage_percent > _doubt(one)]
        serious = any(map(_one_sided, leaking))
        at, advice = _where(humming)
        labels = listed([*dict.fromkeys(one.label for one in humming)])
        yield Finding(
            "asynchronous-line", most.asynchronous_percent, LINE_PERCENT, "% of rated",
            "serious" if serious else "warning" if leaking else "note",
            f"{labels}: the torque has a line at {at} that is not "
            f"locked to the rotor{_doubtful(most)}; its average over the turns keeps a part, which "
            f"changes the RMS error by up to {worst.leakage_percent:.2g} % ({worst.label}); "
            f"{consequence}{_large(leaking) if serious else ''}",
            f"{advice}; take more turns, or other speeds",
        )  # fmt: skip


def _strongest(one: PointRipple) -> AsynchronousLine:
    return max(one.asynchronous_lines, key=lambda line: line.amplitude_Nm)


def _doubtful(one: PointRipple) -> str:
    """Return what is to be said of the amplitude of the strongest line."""
    known = _strongest(one).amplitude_known
    return "" if known else ", of an amplitude that is not known as it is so near to an order"


def _large(leaking: Sequence[PointRipple]) -> str:
    """Return what lines do that make the RMS error look larger."""
    known = any(_strongest(one).amplitude_known for one in leaking if _one_sided(one))
    is_large, makes = ("is", "makes") if known else ("may be", "may make")
    return f", but it {is_large} as large as the ripple and {makes} it look larger"


def _doubt(one: PointRipple) -> float:
    """Return what changes the RMS error (%) from which on it matters next to its noise."""
    return SERIOUS_BIAS * noise_half_width_percent(one)


def _one_sided(one: PointRipple) -> bool:
    """Return whether the lines make the RMS error larger by more than an interval may hold."""
    half = coverage_factor() * (one.stderr_percent or 0.0)
    as_large = one.bias_percent > max(AS_LARGE * one.rms_percent, _doubt(one))
    return as_large or one.bias_percent > SERIOUS_BIAS * half


def _where(humming: Sequence[PointRipple]) -> tuple[str, str]:
    """Return where the strongest lines are, and what to look for.

    Where not the frequency, but the order is the same at all speeds it turns with the rotor.
    """
    frequencies_Hz = [_strongest(one).frequency_Hz for one in humming]
    speeds_Hz = [abs(one.speed_Hz) or inf for one in humming]
    orders = [one / speed_Hz for one, speed_Hz in zip(frequencies_Hz, speeds_Hz, strict=True)]
    if not _alike(frequencies_Hz) and _alike(orders):
        return (
            f"{sum(orders) / len(orders):.2f} orders, at all speeds,",
            "look for what turns with the rotor at another speed (a belt, a gear, another shaft)",
        )
    return (
        f"{listed([*dict.fromkeys(f'{one:.1f}' for one in frequencies_Hz)], between=', ')} Hz",
        "look for mains hum on the torque sensor (50 or 60 Hz and multiples; shield, ground) and "
        "vibration of the bench",
    )


def _alike(values: Sequence[float]) -> bool:
    return max(values) - min(values) < ALIKE * max(values)


def noise_half_width_percent(one: PointRipple) -> float:
    """Return half of the 95 % interval that the RMS error has by its noise alone."""
    return coverage_factor() * (one.noise_stderr_percent or 0.0)


def findings(
    ripples: Sequence[PointRipple],
    consequence: str = "the intervals hold that",
    hidden: str = "0.00 is no measurement, nor are mean and worst",
) -> tuple[Finding, ...]:
    """Return what is questionable about the ripple of the points.

    consequence: what the results make of what lines that are not locked to the rotor change;
    hidden: what they make of RMS errors that noise hides.
    """
    faults = signal_findings((one.label, one.faults) for one in ripples)
    return (
        *_scale(ripples),
        *_one_turn(ripples),
        *_hidden(ripples, hidden),
        *asynchronous_line(ripples, consequence),
        *_worse(ripples),
        *faults,
    )


def _scale(ripples: Sequence[PointRipple]) -> Iterator[Finding]:
    """Yield a finding where mean torque or ripple is of another scale than the torque that was set.

    A sensor that does not pass the mean shows a wrong scale only by ripple that no motor has.
    """
    means_Nm = [(one.torque_Nm, one.mean_Nm) for one in ripples if one.mean_Nm is not None]
    found = tuple(mean_torque_scale(means_Nm, "all RMS errors"))
    yield from found
    worst = max(ripples, key=lambda one: one.rms_percent)
    if not found and worst.rms_percent > MOST_PERCENT:
        what = f"{worst.label}: the ripple"
        yield beyond_rated(what, worst.rms_percent, MOST_PERCENT, "% of rated")


def _one_turn(ripples: Sequence[PointRipple]) -> Iterator[Finding]:
    alone = [one for one in ripples if one.turns < 2]
    if alone:
        yield Finding(
            "one-turn", 1, 2, "turns", "warning",
            f"{listed([one.label for one in alone])}: one whole turn does not show its noise, "
            "which is part of the RMS error then; how far that is off is not known from one turn",
            "take more turns at each point",
        )  # fmt: skip


def is_hidden(one: PointRipple) -> bool:
    """Return whether noise is as large as the RMS error, which it may have made 0."""
    return noise_half_width_percent(one) > max(HIDDEN_PERCENT, one.rms_percent)


def _hidden(ripples: Sequence[PointRipple], consequence: str) -> Iterator[Finding]:
    """Yield a finding where noise hides the RMS error."""
    hidden = [(noise_half_width_percent(one), one) for one in ripples if is_hidden(one)]
    if hidden:
        worst, _ = max(hidden, key=lambda each: each[0])
        most = max(one.rms_percent + half for half, one in hidden)
        yield Finding(
            "noise-hides-ripple", worst, HIDDEN_PERCENT, "% of rated", "warning",
            f"{listed([one.label for _, one in hidden])}: the noise of the torque is larger than "
            f"the RMS error, of which no more is known than that it is below {most:.2g} %; "
            f"{consequence}",
            "look for what disturbs the torque sensor (mains, a loose shield); take more turns",
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
        if one.rms_percent - plain.rms_percent > COVERAGE_FACTOR * noise:
            grown.append((one.rms_percent - plain.rms_percent, COVERAGE_FACTOR * noise, one))
    if grown:
        worst, limit, _ = max(grown, key=lambda each: each[0])
        yield Finding(
            "rougher-with-compensation", worst, limit, "% of rated", "serious",
            f"{listed([one.label for *_, one in grown])}: the torque is rougher with compensation "
            "than without: the calibration is not of this motor, bench or encoder zero",
            "check which calibration is in force; align and calibrate again",
        )  # fmt: skip
