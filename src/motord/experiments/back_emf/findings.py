"""What is questionable about a back-EMF run, each with its meaning and what to do."""

from collections.abc import Iterator, Sequence
from math import sqrt

import numpy as np

from motord.config import SEQUENCE
from motord.experiments.back_emf.between_speeds import distinct_speeds
from motord.experiments.back_emf.encoder_error import lost
from motord.experiments.back_emf.result import MeasuredBackEmf
from motord.experiments.driven_rotor import left_out_finding
from motord.experiments.signal_findings import signal_findings
from motord.findings import Finding
from motord.identification.cluster_robust_ls import FEWEST_TURNS
from motord.identification.rotor.driven_rotor import JERKY, Driven

UNBALANCED = 0.002
"""Part of the fundamental by which a phase may differ from the mean of the three."""

DELAY_MAX_S = 2e-3
"""Age of the voltages, beyond the recorded one, that filters and buses explain."""

CONFIGURED_PART = 0.1
"""Part of the fundamental by which it may differ from that of [motor]: magnets differ by less from
motor to motor, and 0.1 rad is a badly aligned encoder."""

LEAST_SPEEDS = 3
"""Distinct speeds, with their signs, from which on a phase that differs from speed to speed shows
next to the age of the voltages."""

SPEED_RATIO = 1.3
"""Ratio of the fastest to the slowest speed that separates the voltages' age from the angle."""

CLOCKS_NOT_SEEN = (
    ", and so do, at so few speeds, clocks of inverter and encoder that run apart, which turn the "
    "phases"
)
"""Why an age that nothing explains leaves the phases in doubt."""

TRENDS = {
    "time": (
        "amplitude-drifts",
        "change with the time: magnets that warm (0.1 to 0.2 % for each kelvin), or the gain of "
        "the voltage channels; stated is the mean, and the intervals reach to the beginning",
        "name a magnet_channel, or warm the motor up before; take the speeds once more in the "
        "other sequence",
    ),
    "frequency": (
        "amplitude-of-frequency",
        "fall with the square of the frequency: a low-pass of the voltages; stated is the mean "
        "over the speeds, and the intervals reach to what is there without a filter",
        "take the filter out of the voltage channels, or drive slower",
    ),
}
"""Name, meaning and action of the finding of each kind of trend."""


def findings(found: MeasuredBackEmf, driven: Sequence[Driven]) -> tuple[Finding, ...]:
    """Return what is questionable about the run."""
    used_s = sum(float(one.t_s[-1] - one.t_s[0]) for one in driven)
    return (
        *_phases(found),
        *_age(found, driven),
        *_few_turns(found),
        *_orders(found),
        *_encoder(found),
        *_trends(found),
        *_motion(driven),
        *left_out_finding(found.left_out, used_s),
        *signal_findings((one.label, one.faults) for one in driven),
    )


def _phases(found: MeasuredBackEmf) -> Iterator[Finding]:
    first = found.electrical[0]
    turned = np.exp(-2j * np.pi / 3 * SEQUENCE[found.motor.phase_order] * np.arange(3))
    own = found.line[first]
    as_said, other = abs((own * turned.conj()).mean()), abs((own * turned).mean())
    if other > as_said:
        yield Finding(
            "phase-order", float(other), float(as_said), "V s/rad", "serious",
            "phases b and c follow in the other order than [motor] says: harmonics are a mean of "
            "the wrong phases, the table is right",
            "change its phase_order, or encoder_direction (the plan `align` finds which)",
        )  # fmt: skip
        return
    back = found.balanced[0]
    apart = float(np.abs(own * turned.conj() - back).max() / np.abs(back))
    limit = max(UNBALANCED, 4 * float((found.scatter_stderr[first] / np.abs(back)).max()))
    if apart > limit:
        yield Finding(
            "phases-differ", 100 * apart, 100 * limit, "% of the fundamental", "warning",
            "a phase differs from the mean of the three: the windings do, or the voltage channels",
            "use the table, not the harmonics; compare the channels on one voltage",
        )  # fmt: skip
    yield from _configured(found, own)


def _configured(found: MeasuredBackEmf, own: np.ndarray) -> Iterator[Finding]:
    """Yield a finding where the fundamental of the phases (3,) is far from that of [motor]."""
    table = found.motor.back_emf_table()
    lines = 2 * np.fft.rfft(table, axis=0)[found.motor.pole_pairs] / len(table)
    ratio = complex((own * lines.conj()).sum() / (lines * lines.conj()).sum())
    if abs(ratio - 1) > CONFIGURED_PART:
        yield Finding(
            "other-than-configured", 100 * abs(ratio - 1), 100 * CONFIGURED_PART,
            "% of the fundamental", "warning",
            f"the fundamental is {abs(ratio):.3g} times that of [motor] back_emf and "
            f"{np.degrees(np.angle(ratio)):.0f} deg (electrical) from it: scale or sign of the "
            "voltages (1.73: line for phase voltages; 180 deg: sign) or the encoder's zero is "
            "wrong, or [motor] is of another motor",
            "measure a phase with an oscilloscope; align the encoder (`motord plan start align`); "
            "if [motor] was a guess, use the measured table",
        )  # fmt: skip


def _age(found: MeasuredBackEmf, driven: Sequence[Driven]) -> Iterator[Finding]:
    if found.delay_s is None:
        speeds_Hz = found.speeds_Hz
        yield Finding(
            "age-not-seen", max(speeds_Hz) / min(speeds_Hz), SPEED_RATIO, "ratio of speeds",
            "warning",
            "all speeds are alike: an age of the voltages that the recording does not state would "
            "turn the waves, and cannot be seen",
            f"drive at speeds {SPEED_RATIO} times apart or more",
        )  # fmt: skip
        return
    signed_Hz = np.array([one.direction * one.speed_Hz for one in driven])
    speeds = np.unique(distinct_speeds(signed_Hz)).size if driven else LEAST_SPEEDS
    if speeds < LEAST_SPEEDS:
        yield Finding(
            "phase-drift-not-seen", speeds, LEAST_SPEEDS, "speeds", "warning",
            "with two speeds, taken once or more often, the age of the voltages takes up whatever "
            "their phase differs by from one to the other: where it drifts (an encoder that slips, "
            "a reference that changes), age and phases are off by more than their intervals; "
            "amplitudes are not concerned",
            "drive at three speeds or more",
        )  # fmt: skip
    delay_s, stderr_s, _ = found.delay_s
    if abs(delay_s) > DELAY_MAX_S + 4 * stderr_s:
        apart = any(one.kind == "clock" and one.tested for one in found.trends)
        yield Finding(
            "age-of-voltages", 1e3 * abs(delay_s), 1e3 * DELAY_MAX_S, "ms",
            "warning" if apart else "serious",
            f"the voltages seem {1e3 * delay_s:+.2f} ms older than the recording says: more than "
            "filters and buses explain; a speed or an encoder error that changes with speed looks "
            "the same" + CLOCKS_NOT_SEEN * (not apart),
            "check the inverter's time stamps and filters"
            + ("" if apart else "; drive at three speeds in both directions"),
        )  # fmt: skip


def _few_turns(found: MeasuredBackEmf) -> Iterator[Finding]:
    """Yield a finding where turns of a speed are too few to show the colour of its noise."""
    fewest = min(found.turns)
    if fewest < FEWEST_TURNS:
        yield Finding(
            "few-turns", fewest, FEWEST_TURNS, "turns", "warning",
            "the standard errors of a speed of so few turns take the noise to be white: they do "
            "not show its colour",
            f"drive {FEWEST_TURNS} turns or more at each speed",
        )  # fmt: skip


def _orders(found: MeasuredBackEmf) -> Iterator[Finding]:
    others = found.kept & (found.order % found.motor.pole_pairs != 0)
    if others.any():
        size = np.abs(found.line).max(axis=1)
        largest = int(np.argmax(np.where(others, size, 0)))
        listed = ", ".join(str(order) for order in found.order[others])
        yield Finding(
            "unexplained-orders", 1e3 * float(size[largest]),
            1e3 * float(found.stderr[largest].max()), "mV s/rad", "note",
            f"orders per turn that are no multiple of the pole pairs: {listed}: unequal magnets, "
            "an eccentric rotor or encoder",
            "next to the fundamental's order: check that the encoder is concentric",
        )  # fmt: skip


def _encoder(found: MeasuredBackEmf) -> Iterator[Finding]:
    """Yield a finding for an angle that is off once or twice a turn; named as `calibrate` does."""
    for one in found.encoder:
        if not one.significant:
            continue
        percent = 100 * lost([one], found.order[found.electrical][:1])
        yield Finding(
            f"encoder-error-order-{one.order}", float(np.degrees(one.error_rad)),
            float(np.degrees(one.limit_rad)), "deg", "warning",
            f"the fundamental has sidebands at {one.order} from its order, as of "
            f"an encoder that is {'oval or misaligned' if one.order > 1 else 'eccentric'}: it is "
            f"{float(percent[0]):.2g} % larger than stated, higher orders by more; the intervals "
            "hold that. The table is that of the angle that this encoder reads",
            "centre and align the encoder's disc on its shaft and measure again",
        )  # fmt: skip


def _trends(found: MeasuredBackEmf) -> Iterator[Finding]:
    """Yield a finding for the trend that explains best what amplitudes differ by."""
    significant = [one for one in found.trends if one.significant]
    for one in significant:
        if one.kind == "clock":
            drift_us = 1e6 * abs(one.slope)
            yield Finding(
                "clocks-drift", drift_us, drift_us * one.limit / abs(one.ratio), "us", "serious",
                "the age of the voltages changed by this much from the first to the last speed: "
                "the clocks of inverter and encoder run apart; phases are off, and their intervals "
                "and that of the age hold by how much, roughly",
                "synchronise the clocks, or take the time of each sample from one of them",
            )  # fmt: skip
    shown = [one for one in significant if one.kind != "clock"]
    if not shown:
        return
    best = max(shown, key=lambda one: abs(one.ratio))
    part = abs(float(best.part[found.electrical[0]]))
    name, meaning, action = TRENDS[best.kind]
    yield Finding(
        name, 100 * part, 100 * part * best.limit / abs(best.ratio), "% of the fundamental",
        "warning", f"the amplitudes of the speeds {meaning}", action,
    )  # fmt: skip


def _motion(driven: Sequence[Driven]) -> Iterator[Finding]:
    jerky = [one for one in driven if one.jerky]
    if jerky:
        worst = max(one.residual_rms_rad / one.rounding_rad for one in jerky)
        at = ", ".join(f"{one.direction * one.speed_Hz:.3g} /s" for one in jerky)
        yield Finding(
            "jerky-motion", worst / sqrt(12), JERKY / sqrt(12), "counts", "serious",
            f"at {at} the rotor sticks and slips: no smooth motion explains the encoder, and the "
            "speed, which the voltages are divided by, is not known",
            "drive faster, or through a stiffer belt",
        )  # fmt: skip
