"""Identifiability: which directions the data leave open, and the constraints that fix them.

alpha_a alpha_b alpha_c = 1, sum of beta = 0.

An AC coupled sensor does not see the mean torque, and with programmed currents the common gain of
the phases makes nothing but mean torque; a common offset of the currents makes no torque unless
the back-EMF has triplen harmonics. Poels 2008, eq. (4.17), (4.18).
"""

from dataclasses import dataclass, replace

import numpy as np

from motord.experiments.calibration.estimate.least_squares.normal_equations import ALPHA, BETA

COMMON = np.ones(3) / 3**0.5
"""The same change of all three phases."""

COMMON_GAIN_SHARE = 0.03
"""Share of the torque that a phase's gain makes, below which a common gain counts as unseen."""

COMMON_GAIN_STDERR = 0.01
"""Standard error above which a common gain counts as unseen."""

COMMON_OFFSET_SHARE = 0.02
"""As COMMON_GAIN_SHARE, for the common offset."""

COMMON_OFFSET_STDERR = 0.005
"""As COMMON_GAIN_STDERR, for the common offset, in parts of the rated current."""

NEARLY = 5.0
"""By so much a common gain or offset may miss what counts as seen and still widen the errors."""


@dataclass(frozen=True)
class Identifiability:
    """gain_direction (3,): the change of alpha that no data show, None if all is seen.

    offset_seen: whether the common offset of the currents is seen. gain_nearly, offset_nearly:
    whether what is not seen nearly is: fixing it is then a decision that may be wrong.
    """

    gain_direction: np.ndarray | None
    offset_seen: bool
    gain_nearly: bool = False
    offset_nearly: bool = False

    def opened(self) -> "Identifiability":
        """Return the same with all that is nearly seen taken for seen."""
        return replace(
            self,
            gain_direction=None if self.gain_nearly else self.gain_direction,
            offset_seen=self.offset_seen or self.offset_nearly,
            gain_nearly=False,
            offset_nearly=False,
        )

    def subspace(self, parameters: int) -> np.ndarray:
        """Return an orthonormal basis (parameters, m) of what is estimated from the data."""
        unseen = np.zeros((parameters, 0))
        if self.gain_direction is not None:
            unseen = np.column_stack([unseen, _embed(self.gain_direction, ALPHA, parameters)])
        if not self.offset_seen:
            unseen = np.column_stack([unseen, _embed(COMMON, BETA, parameters)])
        if unseen.shape[1] == 0:
            return np.eye(parameters)
        full = np.linalg.svd(unseen, full_matrices=True)[0]
        return np.ascontiguousarray(full[:, unseen.shape[1] :])

    def gain_vector(self, parameters: int) -> np.ndarray:
        """Return the unseen change of alpha among all parameters; zero if there is none."""
        if self.gain_direction is None:
            return np.zeros(parameters)
        return _embed(self.gain_direction, ALPHA, parameters)


def _embed(direction: np.ndarray, where: slice, parameters: int) -> np.ndarray:
    vector = np.zeros(parameters)
    vector[where] = direction
    return vector


def assess(
    information: np.ndarray, torque_information: np.ndarray, rated_A: float
) -> Identifiability:
    """Return what the data show.

    information: Fisher information of all parameters; torque_information: the part of it that
    the torque gives (the rest comes from Kirchhoff's law). rated_A: peak of the rated current.
    """
    alpha = _after_elimination(information, ALPHA)
    values, vectors = np.linalg.eigh(alpha)
    largest = np.linalg.eigvalsh(_after_elimination(torque_information, ALPHA))[-1]
    gain = _visibility(values[0], largest, COMMON_GAIN_SHARE, COMMON_GAIN_STDERR)
    direction = vectors[:, 0] * np.sign(vectors[:, 0].sum() or 1.0)
    if gain < 1:  # it is fixed, so that an offset is not separable from it
        fixed = _embed(direction, ALPHA, len(information))
        information = information + np.outer(fixed, fixed) * np.trace(information)
    beta = _after_elimination(information, BETA)
    largest = np.linalg.eigvalsh(_after_elimination(torque_information, BETA))[-1]
    offset = _visibility(
        _information_along(beta, COMMON),
        largest,
        COMMON_OFFSET_SHARE,
        COMMON_OFFSET_STDERR * rated_A,
    )
    return Identifiability(
        None if gain >= 1 else direction,
        offset >= 1,
        gain_nearly=1 / NEARLY <= gain < 1,
        offset_nearly=1 / NEARLY <= offset < 1,
    )


def _visibility(information: float, largest: float, share: float, stderr: float) -> float:
    """Return how well something is seen, in parts of what counts as seen."""
    if information <= 0:
        return 0.0
    known = float(np.sqrt(information))
    return min(known * stderr, known / share / max(float(np.sqrt(max(largest, 0.0))), 1e-300))


def _information_along(matrix: np.ndarray, direction: np.ndarray) -> float:
    """Return 1 / variance of a combination of parameters, 0 if nothing is known of it."""
    values, vectors = np.linalg.eigh(matrix)
    shares = (vectors.T @ direction) ** 2
    if shares[values <= 1e-12 * values[-1]].sum() > 1e-9:
        return 0.0
    known = values > 1e-12 * values[-1]
    return float(1 / (shares[known] / values[known]).sum())


def _after_elimination(information: np.ndarray, block: slice) -> np.ndarray:
    """Return the information on a block of parameters when all others are unknown (Schur)."""
    rest = np.ones(information.shape[0], bool)
    rest[block] = False
    cross = information[block][:, rest]
    inner = information[np.ix_(rest, rest)]
    explained = cross @ np.linalg.pinv(inner, rcond=1e-10, hermitian=True) @ cross.T
    return np.asarray(information[block, block] - (explained + explained.T) / 2)


def unit_product(base: np.ndarray, direction: np.ndarray) -> float:
    """Return s for which the product of base + s direction (all three positive) is 1.

    nan if no such s leaves all three positive.
    """
    polynomial = np.ones(1)
    for b, d in zip(base, direction, strict=True):
        polynomial = np.convolve(polynomial, [d, b])
    polynomial[-1] -= 1.0
    roots = np.roots(np.trim_zeros(polynomial, "f"))
    real = roots[np.abs(roots.imag) < 1e-9].real
    fitting = [float(s) for s in real if (base + s * direction > 0).all()]
    return min(fitting, key=abs, default=float("nan"))
