"""Phase order, encoder direction and encoder zero from the rests of a rotor under a current vector.

At rest the torque of the currents balances cogging torque and friction:

    sum_p (alpha_p i_p + beta_p) k_p(theta + offset) + tau_cog(theta) = f way + noise

Currents, and angles at which it rests, are known. The offset is what fits best; what would bend
the result (unequal gains, offsets of the currents, cogging, friction, load) is fitted along, each
with a wide prior, as it need not show.
"""

from collections.abc import Sequence

import numpy as np

from motord.config import SEQUENCE, BackEmfHarmonic, MotorConfig, PhaseOrder
from motord.config.motor import back_emf_waves
from motord.config.motor.back_emf import BackEmfTable
from motord.experiments.alignment.rests import Rests, rests_of
from motord.experiments.alignment.rests_checks import (
    check_pole_pairs,
    check_rests,
    current_gains,
    torque_answer,
    turns_of,
)
from motord.experiments.alignment.result import Alignment
from motord.identification import IdentifyError
from motord.identification.orders import allowed_orders

ORDERS_PER_PERIOD = 12
"""Highest order of the cogging torque that is fitted, in multiples of the pole pairs."""

LOAD_ORDERS = (1, 2)
"""Orders of a torque from outside, such as by a rotor that is not balanced or a bent coupling."""

GAIN_PRIOR, OFFSET_PRIOR, COGGING_PRIOR, FRICTION_PRIOR, LOAD_PRIOR = 0.2, 0.05, 0.05, 0.02, 0.02
"""Standard deviations: gains; offsets in parts of the current that makes the rated torque; each
order of the cogging torque, friction, and each order of the load in parts of the rated torque."""

ITERATIONS = 50
WEIGHINGS = 8
"""Iterations after which the weights of outliers stay as they are."""

CONVERGED_RAD = 1e-7
OUTLIER = 2.0
"""Residuals beyond so many standard deviations count less (Huber)."""

FRICTION_SHARE = 1 / 3
"""Part of what friction takes a single rest off by that all rests may have in common."""

TURN = 2 * np.pi


def align(sweeps: Sequence[np.ndarray], motor: MotorConfig) -> Alignment:
    """Return the alignment from the ticks of `sweeps`, each with the columns `rests.REQUIRED`.

    motor: of the bench file that they were taken with. Forwards is where the torque sensor shows
    positive torque; if it shows none, where the encoder counts up by it. Raises IdentifyError.
    """
    if isinstance(motor.back_emf, BackEmfTable):
        raise IdentifyError(
            "[motor] back_emf is a measured table, which has direction and zero in it; name "
            "harmonics to align the encoder to them"
        )
    rests = rests_of(sweeps, motor.counts, motor.pole_pairs)
    check_rests(rests)
    gains = current_gains(rests)
    turn_rad, turn_stderr_rad = turns_of(rests)
    pole_pairs = check_pole_pairs(turn_rad, turn_stderr_rad, motor.pole_pairs)
    answer = torque_answer(sweeps, motor.counts)
    forwards = answer.way or 1
    order: PhaseOrder = "abc" if turn_rad * forwards > 0 else "acb"
    used = rests[rests.still]
    fit = _fitted(used, forwards * used.encoder_rad, motor, motor.back_emf, order)
    stuck_Nm = fit.left_Nm - fit.held_Nm
    friction_rad = float(np.sqrt(np.mean((stuck_Nm / fit.stiffness) ** 2)))
    return Alignment(
        motor=motor,
        phase_order=order,
        direction=motor.encoder_direction * forwards,
        offset_rad=_nearest_zero(fit.offset_rad, TURN / motor.pole_pairs),
        offset_stderr_rad=float(np.hypot(fit.stderr_rad, FRICTION_SHARE * friction_rad)),
        pole_pairs=pole_pairs,
        friction_Nm=float(np.sqrt(np.mean(stuck_Nm**2))),
        friction_rad=friction_rad,
        gains=gains,
        answer=answer,
        rests=rests,
        left_out=int((~rests.still).sum()),
        angle_rad=(fit.angle_rad + fit.offset_rad) % TURN,
        apart_rad=fit.apart_rad(),
        left_rad=fit.left_Nm / fit.stiffness,
        degrees_of_freedom=fit.freedom,
    )


def _fitted(
    rests: Rests,
    angle_rad: np.ndarray,
    motor: MotorConfig,
    harmonics: Sequence[BackEmfHarmonic],
    order: PhaseOrder,
) -> "_Fit":
    """Return the fit, with a load where the rests show one: by the Bayesian information criterion.

    Of few rests, or at one current, a load looks like an offset. Raises IdentifyError.
    """
    plain, loaded = (
        _Fit(rests, angle_rad, motor, harmonics, order, loads) for loads in ((), LOAD_ORDERS)
    )
    plain.run()
    try:
        loaded.run()
    except IdentifyError:
        return plain
    more = loaded.unknowns.size - plain.unknowns.size
    gained = angle_rad.size * np.log(plain.square_Nm2 / max(loaded.square_Nm2, 1e-30))
    return loaded if gained > more * np.log(angle_rad.size) else plain


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
    freedom; unknowns: gains of b and c against a, offsets (A), cogging (Nm), friction (Nm);
    left_Nm (n,), with square_Nm2, the weighted sum of their squares; stiffness (n,): how the torque
    of the currents changes with the angle (Nm/rad).
    """

    def __init__(
        self,
        rests: Rests,
        angle_rad: np.ndarray,
        motor: MotorConfig,
        harmonics: Sequence[BackEmfHarmonic],
        order: PhaseOrder,
        load_orders: Sequence[int],
    ) -> None:
        self.angle_rad, self._rests, self._motor = angle_rad, rests, motor
        self._harmonics, self._order = harmonics, order
        self._current_A = rests.command_A
        highest = ORDERS_PER_PERIOD * motor.pole_pairs
        orders = allowed_orders(motor.slots, 2 * motor.pole_pairs, highest)
        loads = [h for h in load_orders if h not in orders]
        self._fixed = np.stack(
            [wave(h * angle_rad) for h in (*orders, *loads) for wave in (np.cos, np.sin)]
            + [-SEQUENCE[order] * rests.way.astype(float)],
            axis=1,
        )
        rated_Nm, line = motor.rated_torque_Nm, abs(_fundamental(harmonics))
        self._prior = np.concatenate(
            [
                np.full(2, GAIN_PRIOR),
                np.full(3, OFFSET_PRIOR * rated_Nm / (1.5 * line)),
                np.full(2 * len(orders), COGGING_PRIOR * rated_Nm),
                np.full(2 * len(loads), LOAD_PRIOR * rated_Nm),
                [FRICTION_PRIOR * rated_Nm],
            ]
        )
        self.unknowns = np.zeros(self._prior.size)
        self.left_Nm = self.stiffness = np.zeros(angle_rad.size)
        self.square_Nm2 = np.inf
        self.offset_rad, self.stderr_rad = self._first_guess_rad(), np.inf

    def run(self) -> None:
        """Fit. Raises IdentifyError if it does not come to an end."""
        weight, noise_Nm = np.ones(self.angle_rad.size), 0.01 * self._motor.rated_torque_Nm
        for number in range(ITERATIONS):
            step_rad = self._step(weight, noise_Nm)
            if number < WEIGHINGS:
                noise_Nm = self._noise_Nm(weight)
                far = np.abs(self.left_Nm) / (OUTLIER * noise_Nm)
                weight = 1 / np.maximum(1.0, far)
            elif abs(step_rad) < CONVERGED_RAD:
                self.square_Nm2 = float(weight @ self.left_Nm**2)
                return
        raise IdentifyError(
            "no encoder offset fits the rests of the rotor: do [motor] back_emf, slots and "
            "pole_pairs fit the motor?"
        )

    @property
    def held_Nm(self) -> np.ndarray:
        """What friction explains, (n,): alike at all rests of one way."""
        return np.asarray(self._fixed[:, -1] * self.unknowns[-1])

    def apart_rad(self) -> np.ndarray:
        """Return how far each rest is from that of the vector alone, (n,), mechanical."""
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
        """Return the offset that the mean of the rests says."""
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
        """Solve for all unknowns and a step of the offset; take it, and return it."""
        nudge_rad = 1e-5 / self._motor.pole_pairs
        k = self._back_emf(self.offset_rad)
        ahead, behind = (self._back_emf(self.offset_rad + s * nudge_rad) for s in (1, -1))
        i_A, torque = self._current_A, self._current_A * k
        self.stiffness = (i_A * (ahead - behind)).sum(axis=1) / (2 * nudge_rad)
        gains = torque[:, 1:] - torque[:, :1]
        columns = np.concatenate([self.stiffness[:, np.newaxis], gains, k, self._fixed], axis=1)
        made_Nm = torque.sum(axis=1)
        scaled = columns * (weight / noise_Nm**2)[:, np.newaxis]
        information = scaled.T @ columns
        normal = information.copy()
        normal[np.arange(1, columns.shape[1]), np.arange(1, columns.shape[1])] += self._prior**-2
        solution = np.linalg.solve(normal, -scaled.T @ made_Nm)
        self.left_Nm = made_Nm + columns @ solution
        inverse = np.linalg.inv(normal)
        self.stderr_rad = float(np.sqrt(inverse[0, 0]))
        self.freedom = max(int(weight.size - np.trace(inverse @ information)), 1)
        self.unknowns = solution[1:]
        self.offset_rad += float(solution[0])
        return float(solution[0])

    def _noise_Nm(self, weight: np.ndarray) -> float:
        """Return the noise that is left, at least what the encoder's rounding makes."""
        free = max(self.angle_rad.size - self._prior.size, self.angle_rad.size // 4)
        left_Nm = float(np.sqrt((weight * self.left_Nm**2).sum() / free))
        rounding_rad = TURN / self._motor.counts / np.sqrt(12)
        return max(left_Nm, float(rounding_rad * np.abs(self.stiffness).mean()))
