"""Theory of the ripple that errors of gains, offsets and compensated cogging torque leave.

Poels 2008, chapter 4: programmed currents of a set-point T, less the cogging torque that is
compensated, flow with gains and offsets that are not quite right,

    tau = sum_p (g_p i_p + b_p) k_p + tau_cog,   i_p = (T - f tau_cog) n_p / sum_q k_q n_q,

with n = k for independent phases and n_p = k_p - mean_q k_q for a star; its RMS error is (4.16).
The gauge (4.17), (4.18) gives phases b and c what phase a leaves them. Over gain, offset and
cogging factor it is a volume, and where it is too much, a surface (Table 4.1, Figures 4.3, 4.4).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from motord.config import MotorConfig
from motord.identification import IdentifyError
from motord.identification.least_loss import currents_per_Nm

ERRORS: dict[str, tuple[float, float]] = {
    "alpha_a": (1.0, 0.9),
    "beta_a_A": (0.0, 1e3),
    "cogging": (1.0, 1e3),
}
"""Each single error: where it is ideal, and how far off it could be."""

INTERVALS = {"alpha_a": (0.8, 1.2), "beta_a_A": (-1.0, 1.0), "cogging": (0.65, 1.35)}
"""The intervals of Table 4.1: gain and offset of phase a, factor of the cogging torque."""


def gains_of(alpha_a: ArrayLike) -> np.ndarray:
    """Return the three gains (..., 3) of product 1 with alpha_b = alpha_c, eq. (4.17)."""
    a = np.asarray(alpha_a, float)
    return np.stack([a, a**-0.5, a**-0.5], axis=-1)


def offsets_of(beta_a_A: ArrayLike) -> np.ndarray:
    """Return the three offsets (..., 3) of sum 0 with beta_b = beta_c, eq. (4.18)."""
    b = np.asarray(beta_a_A, float)
    return np.stack([b, -b / 2, -b / 2], axis=-1)


@dataclass(frozen=True)
class RippleModel:
    """Motor and cogging torque as mean products over the turn: what errors do to the torque.

    products (22, 22) of the torques, without their means, of k_q (3), k_q w_r (9), tau_cog and
    k_q w_r tau_cog (9), with w_r = n_r / sum_p k_p n_p. share (3,): in a star, how the phases take
    up what the wanted currents leave of Kirchhoff's law, in proportion to the gains of their
    sensors; None for the gains that are in error themselves.
    """

    products: np.ndarray
    rated_torque_Nm: float
    star: bool
    share: tuple[float, float, float] | None = None

    @classmethod
    def of(
        cls,
        motor: MotorConfig,
        tau_cog_Nm: np.ndarray,
        share: tuple[float, float, float] | None = None,
    ) -> "RippleModel":
        """Return the model of a motor with its cogging torque (counts,). Raises IdentifyError."""
        if tau_cog_Nm.shape != (motor.counts,):
            raise IdentifyError(
                f"the cogging torque has {tau_cog_Nm.size} values, the motor {motor.counts} counts"
            )
        k, w = motor.back_emf_table(), currents_per_Nm(motor)
        per_Nm = (k[:, :, None] * w[:, None, :]).reshape(-1, 9)
        cog = tau_cog_Nm[:, None]
        torques = np.column_stack([k, per_Nm, cog, per_Nm * cog])
        torques -= torques.mean(axis=0)
        star = motor.connection == "star"
        return cls(torques.T @ torques / len(torques), motor.rated_torque_Nm, star, share)

    def rms_percent(
        self,
        torque_Nm: float,
        gains: ArrayLike = (1.0, 1.0, 1.0),
        offsets_A: ArrayLike = (0.0, 0.0, 0.0),
        cogging: ArrayLike = 1.0,
    ) -> np.ndarray:
        """Return the RMS error, eq. (4.16), percent of rated torque.

        gains (..., 3) and offsets_A (..., 3) of the phases; cogging (...): factor of the cogging
        torque that is compensated. They are broadcast together.
        """
        g, b, f = (np.asarray(x, float) for x in (gains, offsets_A, cogging))
        flowing = g[..., None, :] * np.eye(3)
        if self.star:
            share = g if self.share is None else np.asarray(self.share)
            share = share / share.sum(axis=-1, keepdims=True)
            flowing = flowing - share[..., :, None] * g[..., None, :]
            b = b - share * b.sum(axis=-1, keepdims=True)
        flow = flowing.reshape(*flowing.shape[:-2], 9)
        f = f[..., None]
        shape = np.broadcast_shapes(flow.shape[:-1], b.shape[:-1], f.shape[:-1])
        parts = (b, torque_Nm * flow, np.ones(1), -f * flow)
        v = np.concatenate([np.broadcast_to(x, (*shape, x.shape[-1])) for x in parts], axis=-1)
        square = np.einsum("...i,...i->...", v @ self.products, v)
        return np.asarray(100 * np.sqrt(np.maximum(square, 0.0)) / self.rated_torque_Nm)


def single(model: RippleModel, torque_Nm: float, what: str, value: ArrayLike) -> np.ndarray:
    """Return the RMS error for values of one of ERRORS, the others being ideal."""
    if what == "alpha_a":
        return model.rms_percent(torque_Nm, gains_of(value))
    if what == "beta_a_A":
        return model.rms_percent(torque_Nm, offsets_A=offsets_of(value))
    return model.rms_percent(torque_Nm, cogging=value)


def limits(
    model: RippleModel, torque_Nm: float, what: str, limit_percent: float = 1.0
) -> tuple[float, float]:
    """Return between which values of one of ERRORS alone the RMS error is within a limit.

    An infinity stands for a limit that is not reached.
    """
    ideal, far = ERRORS[what]
    ends = []
    for way in (-1.0, 1.0):
        low, high = 0.0, far
        if single(model, torque_Nm, what, ideal + way * far) < limit_percent:
            ends.append(way * float("inf"))
            continue
        for _ in range(60):
            middle = (low + high) / 2
            below = single(model, torque_Nm, what, ideal + way * middle) < limit_percent
            low, high = (middle, high) if below else (low, middle)
        ends.append(ideal + way * low)
    return ends[0], ends[1]


@dataclass(frozen=True)
class Volume:
    """RMS error in percent over alpha_a (na,), beta_a_A (nb,) and cogging (nf,): (na, nb, nf)."""

    alpha_a: np.ndarray
    beta_a_A: np.ndarray
    cogging: np.ndarray
    rms_percent: np.ndarray


def volume(model: RippleModel, torque_Nm: float, steps: int = 41) -> Volume:
    """Return the RMS error over the intervals (Poels 2008, Figure 4.3)."""
    alpha_a, beta_a_A, cogging = (np.linspace(*ends, steps) for ends in INTERVALS.values())
    a, b, f = np.meshgrid(alpha_a, beta_a_A, cogging, indexing="ij")
    rms = model.rms_percent(torque_Nm, gains_of(a), offsets_of(b), f)
    return Volume(alpha_a, beta_a_A, cogging, rms)


@dataclass(frozen=True)
class Surface:
    """Where the RMS error reaches a limit, seen from the ideal: (n, m) points of a closed surface.

    Cut off at the edges of the intervals, where `inside` (n, m) is True.
    """

    alpha_a: np.ndarray
    beta_a_A: np.ndarray
    cogging: np.ndarray
    inside: np.ndarray


def limit_surface(
    model: RippleModel,
    torque_Nm: float,
    limit_percent: float = 1.0,
    rows: int = 25,
    columns: int = 48,
) -> Surface:
    """Return the surface of RMS error `limit_percent` (Poels 2008, Figure 4.4).

    Along each direction from the ideal, in parts of the half-intervals, the error rises steadily:
    halving finds where it reaches the limit.
    """
    polar, azimuth = np.meshgrid(
        np.linspace(0, np.pi, rows), np.linspace(0, 2 * np.pi, columns + 1), indexing="ij"
    )
    a, b, f = (high - low for low, high in INTERVALS.values())
    way = (
        np.cos(azimuth) * np.sin(polar) * a / 2,
        np.sin(azimuth) * np.sin(polar) * b / 2,
        np.cos(polar) * f / 2,
    )
    low, high = np.zeros_like(polar), _to_the_edges(way)
    inside = _along(model, torque_Nm, way, high) < limit_percent
    edge = high.copy()
    for _ in range(24):
        middle = (low + high) / 2
        below = _along(model, torque_Nm, way, middle) < limit_percent
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    far = np.where(inside, edge, low)
    return Surface(1 + far * way[0], far * way[1], 1 + far * way[2], inside)


def _to_the_edges(way: tuple[np.ndarray, ...]) -> np.ndarray:
    """Return how far the edges of the intervals are along each direction."""
    far = np.full(way[0].shape, np.inf)
    for w, centre, (low, high) in zip(way, (1.0, 0.0, 1.0), INTERVALS.values(), strict=True):
        with np.errstate(divide="ignore", invalid="ignore"):
            edge = np.where(w > 0, (high - centre) / w, (low - centre) / w)
        far = np.minimum(far, np.where(np.abs(w) > 1e-12, edge, np.inf))
    return far


def _along(
    model: RippleModel, torque_Nm: float, way: tuple[np.ndarray, ...], far: np.ndarray
) -> np.ndarray:
    """Return the RMS error at `far` along each direction."""
    alpha_a, beta_a_A, cogging = 1 + far * way[0], far * way[1], 1 + far * way[2]
    return model.rms_percent(torque_Nm, gains_of(alpha_a), offsets_of(beta_a_A), cogging)
