"""Lines of the torque that are not locked to the rotor, such as mains hum, as a finding."""

from collections.abc import Iterator, Sequence
from math import inf

from motord.findings import Finding, listed
from motord.identification.point_ripple import PointRipple
from motord.intervals import SERIOUS_BIAS, coverage_factor

LINE_PERCENT = 0.1
"""Amplitude, percent of rated, of a line that is not locked to the rotor from which on it is said:
what rings in a torque sensor that is compensated is below."""

AS_LARGE = 1 - 0.5**0.5
"""Part of the RMS error by which a line makes it larger that is as large as the ripple."""

ALIKE = 0.01
"""Part by which frequencies, or orders, of one line differ from point to point."""


def asynchronous_line(
    ripples: Sequence[PointRipple], consequence: str = "the intervals hold that"
) -> Iterator[Finding]:
    """Yield a finding of lines that are not locked to the rotor; a note where none matters.

    consequence: what the results make of what the lines change.
    """
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
            "locked to the rotor; its average over the turns keeps a part, which changes the RMS "
            f"error by up to {worst.leakage_percent:.2g} % ({worst.label}); {consequence}"
            + (", but it is as large as the ripple and makes it look larger" if serious else ""),
            f"{advice}; take more turns, or other speeds",
        )  # fmt: skip


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
    lines = [max(one.asynchronous_lines, key=lambda line: line.amplitude_Nm) for one in humming]
    frequencies_Hz = [line.frequency_Hz for line in lines]
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
