"""Voltages of a driven rotor at their own instants, fitted by the waves of the back-EMF."""

from dataclasses import dataclass

import numpy as np

from motord.identification.cluster_robust_ls import ClusterFit, Regressors
from motord.identification.driven_rotor import Driven
from motord.identification.resample import rising

VOLTAGES = ("u_a_V", "u_b_V", "u_c_V")


@dataclass(frozen=True)
class VoltageSamples:
    """Voltages at their own instants, all points: n samples."""

    u_V: np.ndarray
    angle_rad: np.ndarray
    speed_rad_s: np.ndarray
    turn: np.ndarray


def voltage_samples(driven: Driven, delay_s: float) -> VoltageSamples:
    """Return the voltages of the whole turns, with angle and speed `delay_s` before they say."""
    u_V = np.column_stack([driven.ticks[name].astype(float) for name in VOLTAGES])
    at_s = driven.t_s
    if "i_age_ns" in (driven.ticks.dtype.names or ()):
        at_s = at_s - driven.ticks["i_age_ns"] * 1e-9
    fresh = rising(at_s)
    at_s = at_s - delay_s
    fresh &= (at_s >= driven.t_s[0]) & (at_s <= driven.t_s[-1])
    rows = [first + np.flatnonzero(fresh[first:end]) for first, end in driven.turns]
    turn = np.repeat(np.arange(len(rows)), [places.size for places in rows])
    chosen = np.concatenate(rows)
    angle_rad, speed_rad_s = driven.motion.at(at_s[chosen])
    return VoltageSamples(u_V[chosen], angle_rad, speed_rad_s, turn)


def joined(parts: list[VoltageSamples]) -> VoltageSamples:
    """Return the samples of all points, their turns numbered on."""
    before = np.cumsum([0, *(int(part.turn[-1]) + 1 for part in parts)])
    return VoltageSamples(
        np.concatenate([part.u_V for part in parts]),
        np.concatenate([part.angle_rad for part in parts]),
        np.concatenate([part.speed_rad_s for part in parts]),
        np.concatenate([part.turn + first for part, first in zip(parts, before, strict=False)]),
    )


def _columns(samples: VoltageSamples, order: np.ndarray) -> np.ndarray:
    """Return speed times cos and sin of each order, and 1 (n, 2 m + 1)."""
    columns = np.empty((samples.turn.size, 2 * order.size + 1))
    for place, h in enumerate(order):
        columns[:, 2 * place] = samples.speed_rad_s * np.cos(h * samples.angle_rad)
        columns[:, 2 * place + 1] = samples.speed_rad_s * np.sin(h * samples.angle_rad)
    columns[:, -1] = 1.0
    return columns


def fit_phases(samples: VoltageSamples, order: np.ndarray) -> list[ClusterFit]:
    """Return the fit of each phase: cos and sin of each order (V s/rad), then the offset (V)."""
    regressors = Regressors.of(_columns(samples, order), samples.turn)
    return [regressors.fit(u_V) for u_V in samples.u_V.T]


def fit_delay(samples: VoltageSamples, order: np.ndarray) -> tuple[float, float]:
    """Return by how much the voltages are older than the recording says, and its error (s).

    u(t) was k at theta - speed delay: the slope of k times speed^2 is one more column.
    """
    regressors = Regressors.of(_columns(samples, order), samples.turn)
    found = []
    for u_V in samples.u_V.T:
        fit = regressors.fit(u_V)
        a, b = fit.solution[:-1].reshape(-1, 2).T
        around = np.column_stack([order * b, -order * a]).ravel()
        slope = regressors.columns[:, :-1] @ around
        found.append(regressors.one_more(fit, -samples.speed_rad_s * slope))
    delay_s, variance = np.array(found).T
    weight = 1 / variance
    mean_s = float((weight * delay_s).sum() / weight.sum())
    return mean_s, float(np.sqrt(1 / weight.sum()))
