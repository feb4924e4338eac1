"""Phase order, encoder direction and encoder zero from the rests of a rotor under a current vector.

At rest the torque of the currents balances cogging torque and friction:

    sum_p (alpha_p i_p + beta_p) k_p(theta + offset) + tau_cog(theta) = f s + noise

s = 1 or -1 being the direction of the vector. Currents, and angles at which it rests, are known.
The offset is fitted by iteratively reweighted least squares (Huber 1964), jointly with what would
bias it (unequal gains, offsets of the currents, cogging, friction, load), each with a wide
Gaussian prior, as the rests need not determine it.
"""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from motord.config import SEQUENCE, BackEmfHarmonic, MotorConfig, PhaseOrder
from motord.config.motor import back_emf_waves
from motord.config.motor.back_emf import BackEmfTable
from motord.experiments.alignment.rests import Rests, rests_of
from motord.experiments.alignment.rests_checks import (
    check_pole_pairs,
    check_rests,
    current_gains,
    electrical_turn,
    torque_response,
)
from motord.experiments.alignment.result import Alignment
from motord.identification import IdentifyError
from motord.identification.orders import allowed_orders

ORDERS_PER_PERIOD = 12
"""Highest order of the cogging torque that is fitted, in multiples of the pole pairs."""

LOADS = ((), (0,), (1, 2), (0, 1, 2))
"""Orders that a torque from outside may have: none; 0 of a weight on a cord, or of a cable; 1 and 2
of a rotor that is not balanced, or a bent coupling."""

STRONG_EVIDENCE = 6.0
"""Difference of the Bayesian information criteria from which on evidence is strong (Kass and
Raftery 1995)."""

GAIN_PRIOR, OFFSET_PRIOR, COGGING_PRIOR, FRICTION_PRIOR, LOAD_PRIOR = 0.2, 0.05, 0.05, 0.02, 0.02
"""Standard deviations: gains; offsets in parts of the current that makes the rated torque; each
order of the cogging torque, friction, and each order of the load in parts of the rated torque."""

ITERATIONS = 50
REWEIGHTINGS = 8
"""Iterations after which the weights of outliers are kept."""

CONVERGED_RAD = 1e-7
HUBER_FACTOR = 2.0
"""Residuals beyond so many standard deviations count less (Huber)."""

FRICTION_SHARE = 1 / 3
"""Part of a single rest's deviation by friction that all rests may have in common."""

TURN = 2 * np.pi


def align(sweeps: Sequence[np.ndarray], motor: MotorConfig) -> Alignment:
    """Return the alignment from the ticks of `sweeps`, each with the columns `rests.REQUIRED`.

    motor: of the bench file that they were taken with. Forwards is where the torque sensor shows
    positive torque; if it shows none, where the encoder counts up by it. Raises IdentifyError.
    """
    harmonics = _harmonics(motor)
    rests = rests_of(sweeps, motor.counts, motor.pole_pairs)
    check_rests(rests)
    gains = current_gains(rests)
    turn_rad, turn_stderr_rad = electrical_turn(rests)
    pole_pairs = check_pole_pairs(turn_rad, turn_stderr_rad, motor.pole_pairs)
    response = torque_response(sweeps, motor.counts)
    forwards = response.direction or 1
    order: PhaseOrder = "abc" if turn_rad * forwards > 0 else "acb"
    used = rests[rests.still]
    fit = _fitted(used, forwards * used.encoder_rad, motor, harmonics, order)
    friction_rad = _rms(fit.friction_Nm / fit.stiffness)
    return Alignment(
        motor=motor,
        phase_order=order,
        direction=motor.encoder_direction * forwards,
        offset_rad=_nearest_zero(fit.offset_rad, TURN / motor.pole_pairs),
        offset_stderr_rad=float(np.hypot(fit.stderr_rad, FRICTION_SHARE * friction_rad)),
        pole_pairs=pole_pairs,
        friction_Nm=_rms(fit.friction_Nm),
        friction_rad=friction_rad,
        gains=gains,
        torque_response=response,
        rests=rests,
        left_out=int((~rests.still).sum()),
        angle_rad=(fit.angle_rad + fit.offset_rad) % TURN,
        deviation_rad=fit.deviation_rad(),
        residual_rad=fit.residual_Nm / fit.stiffness,
        degrees_of_freedom=fit.degrees_of_freedom,
    )


def _fitted(
    rests: Rests,
    angle_rad: np.ndarray,
    motor: MotorConfig,
    harmonics: Sequence[BackEmfHarmonic],
    order: PhaseOrder,
) -> "_Fit":
    """Return the fit, with a load where the rests show one: by the Bayesian information criterion.

    Friction that acts unevenly looks like a small one: where the evidence is not strong, the fit is
    without it, and its error has what it would change. Of few rests, or at one current, a load
    looks like an offset. Raises IdentifyError.
    """
    plain, *loaded = (_Fit(rests, angle_rad, motor, harmonics, order, loads) for loads in LOADS)
    plain.run()
    fits = [plain]
    for fit in loaded:
        with suppress(IdentifyError):
            fit.run()
            fits.append(fit)
    best = min(fits, key=_Fit.information_criterion)
    if plain.information_criterion() - best.information_criterion() > STRONG_EVIDENCE:
        return best
    plain.stderr_rad = float(np.hypot(plain.stderr_rad, best.offset_rad - plain.offset_rad))
    return plain


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _harmonics(motor: MotorConfig) -> Sequence[BackEmfHarmonic]:
    """Return the back-EMF that the zero refers to. Raises IdentifyError if it is a table."""
    if isinstance(motor.back_emf, BackEmfTable):
        raise IdentifyError(
            "[motor] back_emf is a measured table, which has direction and zero in it; name "
            "harmonics to align the encoder to them"
        )
    return motor.back_emf


def _nearest_zero(value_rad: float, period_rad: float) -> float:
    return float((value_rad + period_rad / 2) % period_rad - period_rad / 2)


def _fundamental(harmonics: Sequence[BackEmfHarmonic]) -> complex:
    """Return amplitude and phase of order 1. Raises IdentifyError if there is none."""
    line = sum(
        h.amplitude_V_s_per_rad * complex(np.exp(1j * h.phase_rad))
        for h in harmonics
        if h.order == 1
    )
    if line == 0:
        raise IdentifyError("[motor] back_emf has no order 1: what should the zero be of?")
    return complex(line)


class _Fit:
    """The weighted least squares, iterated over the offset and the weights.

    angle_rad (n,): of the encoder, forwards positive. After `run`: offset_rad, stderr_rad,
    degrees_of_freedom; unknowns: gains of b and c against a, offsets (A), cogging (Nm), friction
    (Nm); residual_Nm (n,); weighted_square_Nm2: weighted sum of its squares; stiffness (n,): how
    the torque of the currents changes with the angle (Nm/rad).
    """

    def __init__(
        self,
        rests: Rests,
        angle_rad: np.ndarray,
        motor: MotorConfig,
        harmonics: Sequence[BackEmfHarmonic],
        order: PhaseOrder,
        loads: Sequence[int],
    ) -> None:
        self.angle_rad, self._rests, self._motor = angle_rad, rests, motor
        self._harmonics, self._order = harmonics, order
        self._current_A = rests.command_A
        highest = ORDERS_PER_PERIOD * motor.pole_pairs
        orders = allowed_orders(motor.slots, 2 * motor.pole_pairs, highest)
        turning = [h for h in loads if h and h not in orders]
        self._fixed = np.stack(
            [np.ones(angle_rad.size)] * (0 in loads)
            + [wave(h * angle_rad) for h in (*orders, *turning) for wave in (np.cos, np.sin)]
            + [-SEQUENCE[order] * rests.direction.astype(float)],
            axis=1,
        )
        rated_Nm, line = motor.rated_torque_Nm, abs(_fundamental(harmonics))
        self._prior = np.concatenate(
            [
                np.full(2, GAIN_PRIOR),
                np.full(3, OFFSET_PRIOR * rated_Nm / (1.5 * line)),
                np.full(int(0 in loads), LOAD_PRIOR * rated_Nm),
                np.full(2 * len(orders), COGGING_PRIOR * rated_Nm),
                np.full(2 * len(turning), LOAD_PRIOR * rated_Nm),
                [FRICTION_PRIOR * rated_Nm],
            ]
        )
        self.unknowns = np.zeros(self._prior.size)
        self.residual_Nm = self.stiffness = np.zeros(angle_rad.size)
        self.weighted_square_Nm2 = np.inf
        self.offset_rad, self.stderr_rad = self._first_guess_rad(), np.inf

    def run(self) -> None:
        """Fit. Raises IdentifyError if it does not come to an end."""
        weight, noise_Nm = np.ones(self.angle_rad.size), 0.01 * self._motor.rated_torque_Nm
        for number in range(ITERATIONS):
            step_rad = self._step(weight, noise_Nm)
            if number < REWEIGHTINGS:
                noise_Nm = self._noise_Nm(weight)
                far = np.abs(self.residual_Nm) / (HUBER_FACTOR * noise_Nm)
                weight = 1 / np.maximum(1.0, far)
            elif abs(step_rad) < CONVERGED_RAD:
                self.weighted_square_Nm2 = float(weight @ self.residual_Nm**2)
                return
        raise IdentifyError(
            "no encoder offset fits the rests of the rotor: do [motor] back_emf, slots and "
            "pole_pairs fit the motor?"
        )

    def information_criterion(self) -> float:
        """Return Schwarz's Bayesian information criterion."""
        n, square_Nm2 = self.angle_rad.size, max(self.weighted_square_Nm2, 1e-30)
        return float(n * np.log(square_Nm2) + self.unknowns.size * np.log(n))

    @property
    def friction_Nm(self) -> np.ndarray:
        """Friction (n,): the fitted one, alike at all rests of a direction, and the residual."""
        return np.asarray(self.residual_Nm - self._fixed[:, -1] * self.unknowns[-1])

    def deviation_rad(self) -> np.ndarray:
        """Return the angle from where the vector alone would hold the rotor, (n,), mechanical."""
        sequence = SEQUENCE[self._order]
        electrical_rad = self._motor.pole_pairs * (self.angle_rad + self.offset_rad)
        turned = np.exp(1j * (sequence * electrical_rad - np.angle(self._rests.vector_A)))
        middle = np.exp(-1j * self._rest_rad() * sequence)
        return np.asarray(sequence * np.angle(turned * middle) / self._motor.pole_pairs)

    def _rest_rad(self) -> float:
        """Return the electrical angle at which the rotor rests under a vector at zero.

        There the torque i (k_a - k_b / 2 - k_c / 2) falls through zero.
        """
        return float(np.pi - np.angle(_fundamental(self._harmonics)))

    def _first_guess_rad(self) -> float:
        """Return the offset by the mean angle between rests and vector."""
        vector_A, pole_pairs = self._rests.vector_A, self._motor.pole_pairs
        sequence = SEQUENCE[self._order]
        turned = np.exp(1j * pole_pairs * self.angle_rad) * np.exp(
            -1j * sequence * np.angle(vector_A)
        )
        mean = complex((np.abs(vector_A) * turned).sum())
        return (self._rest_rad() - float(np.angle(mean))) / pole_pairs

    def _back_emf(self, offset_rad: float) -> np.ndarray:
        electrical_rad = self._motor.pole_pairs * (self.angle_rad + offset_rad)
        return back_emf_waves(self._harmonics, electrical_rad, self._order)

    def _step(self, weight: np.ndarray, noise_Nm: float) -> float:
        """Take a Gauss-Newton step of offset and unknowns; return that of the offset (rad)."""
        difference_rad = 1e-5 / self._motor.pole_pairs
        k = self._back_emf(self.offset_rad)
        ahead, behind = (self._back_emf(self.offset_rad + s * difference_rad) for s in (1, -1))
        i_A, torque = self._current_A, self._current_A * k
        self.stiffness = (i_A * (ahead - behind)).sum(axis=1) / (2 * difference_rad)
        gains = torque[:, 1:] - torque[:, :1]
        columns = np.concatenate([self.stiffness[:, np.newaxis], gains, k, self._fixed], axis=1)
        model_Nm = torque.sum(axis=1)
        scaled = columns * (weight / noise_Nm**2)[:, np.newaxis]
        information = scaled.T @ columns
        normal = information.copy()
        normal[np.arange(1, columns.shape[1]), np.arange(1, columns.shape[1])] += self._prior**-2
        solution = np.linalg.solve(normal, -scaled.T @ model_Nm)
        self.residual_Nm = model_Nm + columns @ solution
        inverse = np.linalg.inv(normal)
        self.stderr_rad = float(np.sqrt(inverse[0, 0]))
        self.degrees_of_freedom = max(int(weight.size - np.trace(inverse @ information)), 1)
        self.unknowns = solution[1:]
        self.offset_rad += float(solution[0])
        return float(solution[0])

    def _noise_Nm(self, weight: np.ndarray) -> float:
        """Return the residual's standard deviation, at least that of the encoder's rounding."""
        free = max(self.angle_rad.size - self._prior.size, self.angle_rad.size // 4)
        deviation_Nm = float(np.sqrt((weight * self.residual_Nm**2).sum() / free))
        rounding_rad = TURN / self._motor.counts / np.sqrt(12)
        return max(deviation_Nm, float(rounding_rad * np.abs(self.stiffness).mean()))
