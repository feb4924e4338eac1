"""Steps of torque together: mean of both directions, repeatability and uncertainty budget.

Errors in variables: where steps scatter, or their angles misfit, by more than noise, the sensor
shows a torque that does not act. Such an error of the regressor makes the inertia too large
(attenuation), at most by what direct and reverse regression differ by (Frisch 1934). The part of it
that the fit absorbs shows in no residual: it is taken as the error by noise times the ratio of the
residual to its noise, alike in all steps. Both are sources of uncertainty then.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import sqrt

import numpy as np
from scipy.special import gammaincinv

from motord.config import AccelerationConfig, TorqueSensorConfig
from motord.experiments.captures_left_out import CapturesLeftOut
from motord.experiments.inertia.fading_friction import FadingFriction
from motord.experiments.inertia.torque_faults import mount_resonance
from motord.experiments.inertia.torque_step import TorqueStep, read_step
from motord.experiments.signal_findings import signal_findings, torque_scale
from motord.findings import Finding
from motord.identification import IdentifyError
from motord.intervals import coverage_factor, t_quantile

RARE = 0.001
"""Probability at which chance alone makes a finding."""

ALIKE = 0.9
"""Resultant of the angles from which steps of a direction begin, 1 where they are the same, from
which on they are alike: random ones, three or four in each, have it in 0.7 or 0.06 % of sets."""

FEW_STEPS = 4
"""Steps below which their scatter says little."""

AGE_TICKS, AGE_LEAST_S = 2.0, 3e-3
"""Ticks, and time, by which torque and angle may be apart: sampling makes a part of a tick."""


@dataclass(frozen=True)
class TorqueSource:
    """A part of the uncertainty, in parts of the inertia."""

    source: str
    uncertainty: float


@dataclass(frozen=True)
class Acceleration:
    """The motor's inertia by acceleration; budget: sources of its uncertainty, largest first.

    freedom: effective degrees of freedom of the uncertainty (Welch-Satterthwaite, GUM G.4),
    None of a step alone.
    """

    experiment = "inertia-acceleration"
    JSON = (
        "experiment", "inertia_kg_m2", "uncertainty_kg_m2", "freedom", "interval_95_kg_m2",
        "commanded_kg_m2", "plain_kg_m2", "budget", "steps",
    )  # fmt: skip

    inertia_kg_m2: float
    uncertainty_kg_m2: float
    freedom: float | None
    commanded_kg_m2: float
    plain_kg_m2: float
    budget: tuple[TorqueSource, ...]
    steps: tuple[TorqueStep, ...]
    findings: tuple[Finding, ...] = ()

    @property
    def half_width_kg_m2(self) -> float:
        """Half of the 95 % interval, by Student's t."""
        return coverage_factor(self.freedom) * self.uncertainty_kg_m2

    @property
    def interval_95_kg_m2(self) -> tuple[float, float]:
        """95 % interval, by Student's t."""
        half = self.half_width_kg_m2
        return self.inertia_kg_m2 - half, self.inertia_kg_m2 + half


@dataclass(frozen=True)
class BothWays:
    """Mean of both directions, of as many as there are, each weighted alike.

    stderr_kg_m2: from how steps of one direction differ, with so many degrees of freedom; of one
    step alone, and of steps that are all alike, from their noise, freedom None. disturbance: part
    by which steps that scatter, or misfit, beyond their noise may bias the mean; 0 for others.
    """

    inertia_kg_m2: float
    stderr_kg_m2: float
    freedom: float | None
    findings: tuple[Finding, ...]
    disturbance: float = 0.0


def accelerate(
    data: Sequence[tuple[str, np.ndarray]],
    counts: int,
    sensor: TorqueSensorConfig,
    settings: AccelerationConfig,
    orders: Sequence[int] = (),
) -> Acceleration:
    """Return the inertia from all steps. Raises IdentifyError where they cannot tell it.

    data: name of each step, and its ticks from the rest before it on, with the columns REQUIRED;
    orders: main ones of the cogging torque. A step that cannot be used is left out, unless there is
    no other. Steps forwards and back are averaged apart first: what drifts has the same sign in
    both, and half of it is what they differ by.
    """
    if not data:
        raise IdentifyError("there is no good step in the recordings")
    steps: list[TorqueStep] = []
    left_out = CapturesLeftOut()
    for n, (name, ticks) in enumerate(data):
        with left_out.noted(name, n):
            steps.append(read_step(n, ticks, counts, sensor, name, orders))
    if not steps:
        raise IdentifyError(f"no step can be used{left_out.as_text}")
    both = _both_ways(steps)
    value = both.inertia_kg_m2
    repetition = TorqueSource("repetition", both.stderr_kg_m2 / value)
    sources = [TorqueSource("gain of the torque sensor", settings.gain_tolerance / sqrt(3))]
    if sensor.highpass_time_constant_s > 0:
        tau_s = sensor.highpass_time_constant_s * (1 + settings.highpass_tolerance)
        longer = sensor.model_copy(update={"highpass_time_constant_s": tau_s})
        reread = partial(read_step, counts=counts, sensor=longer, orders=orders)
        changed = _both_ways(
            [reread(one.index, data[one.index][1], name=one.label) for one in steps]
        )
        other = abs(changed.inertia_kg_m2 / value - 1) / sqrt(3)
        sources.append(TorqueSource("its time constant", other))
    sources.append(repetition)
    if both.disturbance:
        sources.append(TorqueSource("torque that does not act on the rotor", both.disturbance))
    fading = FadingFriction.of([[one.fading for one in way] for way in _ways(steps)])
    if fading.uncertainty:
        sources.append(TorqueSource("friction that changes", fading.uncertainty))
    relative = sqrt(sum(s.uncertainty**2 for s in sources))
    return Acceleration(
        steps=tuple(steps),
        inertia_kg_m2=value,
        uncertainty_kg_m2=value * relative,
        freedom=both.freedom and both.freedom * (relative / repetition.uncertainty) ** 4,
        commanded_kg_m2=float(np.mean([p.commanded_kg_m2 for p in steps])),
        plain_kg_m2=float(np.mean([p.plain_kg_m2 for p in steps])),
        budget=tuple(sorted(sources, key=lambda s: -s.uncertainty)),
        findings=(
            *_scale([step.work_ratio for step in steps]),
            *_age(steps),
            *mount_resonance(steps[0].t_s, sensor),
            *both.findings,
            *fading.findings(),
            *_alike(steps),
            *signal_findings((step.label, step.faults) for step in steps),
            *left_out.findings(),
        ),
    )


def _scale(ratios: Sequence[float]) -> Iterator[Finding]:
    """Yield `torque_scale` of the mean of the steps, with its error by how they scatter.

    Half of its 95 % interval: more would hide a thousand times the torque in two steps.
    """
    error, n = 0.0, len(ratios)
    if n > 1:
        error = coverage_factor(n - 1) * float(np.std(ratios, ddof=1)) / sqrt(n)
    yield from torque_scale(float(np.mean(ratios)), "the inertia", error)


def _age(steps: Sequence[TorqueStep]) -> Iterator[Finding]:
    """Yield a finding where the torque is late or early by more than sampling explains."""
    age_s = float(np.median([step.delay_s for step in steps]))
    limit_s = max(AGE_TICKS * float(np.median(np.diff(steps[0].t_s))), AGE_LEAST_S)
    if abs(age_s) > limit_s:
        yield Finding(
            "torque-age", 1e3 * age_s, 1e3 * limit_s, "ms", "serious",
            "torque and angle fit only if shifted by so much in time, and so large a shift is not "
            "wholly accounted for: a low-pass or an average in the torque channel, or time stamps "
            "that are not those of the sampling",
            "take the filter out of the torque channel, or set it above 200 Hz",
        )  # fmt: skip


def _ways(steps: Sequence[TorqueStep]) -> list[list[TorqueStep]]:
    """Return the steps of each direction that there are, forwards first."""
    ways = ([one for one in steps if (one.angle_rad[-1] > 0) == way] for way in (True, False))
    return [way for way in ways if way]


def _both_ways(steps: Sequence[TorqueStep]) -> BothWays:
    """Return the mean of the steps over both directions."""
    stderr = np.array([step.stderr_kg_m2 for step in steps])
    groups = [np.array([step.inertia_kg_m2 for step in way]) for way in _ways(steps)]
    means = [float(group.mean()) for group in groups]
    mean = float(np.mean(means))
    noise = float(np.sqrt(np.mean(stderr**2)))
    freedom = len(steps) - len(groups)
    reduced = sqrt(sum(1 / group.size for group in groups)) / len(groups)
    scatter = 0.0
    if freedom > 0:
        scatter = sqrt(sum(float(((g - g.mean()) ** 2).sum()) for g in groups) / freedom)
    misfit = tuple(_misfit(steps))
    disturbed = (*misfit, *(_scatter(scatter, noise, freedom) if scatter else ()))
    findings = [*_few(len(steps)), *disturbed]
    attenuation = float(np.mean([one.attenuation for one in steps])) if disturbed else 0.0
    taken_up = sum(one.misfit * one.stderr_kg_m2**2 for one in steps) / len(steps) if misfit else 0
    disturbance = sqrt(attenuation**2 + taken_up / mean**2)
    if scatter == 0:
        return BothWays(mean, noise * reduced, None, tuple(findings), disturbance)
    if len(groups) == 2:
        apart = sqrt(sum(1 / group.size for group in groups)) * scatter
        limit = t_quantile(1 - RARE / 2, freedom) * apart
        findings += _directions(means[0] - means[1], limit)
    return BothWays(mean, scatter * reduced, float(freedom), tuple(findings), disturbance)


def _few(steps: int) -> Iterator[Finding]:
    if steps < FEW_STEPS:
        yield Finding(
            "few-steps", steps, FEW_STEPS, "steps", "warning",
            "what differs from step to step is hardly in the uncertainty",
            "raise repeats",
        )  # fmt: skip


def _alike(steps: Sequence[TorqueStep]) -> Iterator[Finding]:
    """Yield a finding where the steps of each direction begin at the same angle."""
    resultants = [abs(np.exp([1j * one.start_rad for one in way]).mean()) for way in _ways(steps)]
    if len(steps) >= FEW_STEPS and min(resultants) > ALIKE:
        yield Finding(
            "steps-alike", float(min(resultants)), ALIKE, "of 1 for one angle", "note",
            "all steps of a direction begin near the same angle: what goes with the angle (an "
            "eccentric encoder, a coupling out of line) is alike in them, and no scatter shows it",
            "turn the rotor by hand between steps, so that they begin all over the turn",
        )  # fmt: skip


def _misfit(steps: Sequence[TorqueStep]) -> Iterator[Finding]:
    """Yield a finding where angles depart from the torque by more than noise makes by chance.

    Noise that is twice integrated leaves each step one degree of freedom at least.
    """
    times = sqrt(float(np.mean([one.misfit for one in steps])))
    limit = sqrt(_chance_square(len(steps)))
    if times > limit:
        yield Finding(
            "steps-misfit", times, limit, "times the noise", "warning",
            "the angle departs from what the measured torque makes of it by more than noise: the "
            "sensor shows a torque that does not act, as of a coupling, of its resonance, or of "
            "cogging torque that samples do not resolve; the uncertainty takes it in",
            "raise [loop] rate_Hz, or lower torque_Nm and stop_speed_Hz; look at the coupling",
        )  # fmt: skip


def _chance_square(freedom: int) -> float:
    """Return the mean square of so many values of unit variance that chance alone exceeds."""
    return 2 * float(gammaincinv(freedom / 2, 1 - RARE)) / freedom


def _scatter(scatter: float, noise: float, freedom: int) -> Iterator[Finding]:
    """Yield a finding where steps differ by more than the noise that each was seen to have."""
    limit = noise * sqrt(_chance_square(freedom))
    if scatter > limit:
        yield Finding(
            "steps-scatter", scatter, limit, "kg m2", "warning",
            "steps differ by more than the noise of torque sensor and encoder explains: friction "
            "changes, the brake drags or the sensor is disturbed; the uncertainty takes it in",
            "look at the steps in the report; let the brake cool and release fully",
        )  # fmt: skip


def _directions(difference: float, limit: float) -> Iterator[Finding]:
    if abs(difference) > limit:
        yield Finding(
            "directions-differ", abs(difference), limit, "kg m2", "warning",
            "steps forwards give another inertia than steps back: the torque sensor's gain differs "
            "with the sign, or a torque acts in one direction; the mean takes half of it out",
            "look for a cable or a belt on the shaft; check the sensor with a weight both ways",
        )  # fmt: skip
