"""The residual estimator of the report: Poels 2008, eq. (4.5) to (4.14).

Averages over the turns at each encoder point, one pseudo-inverse for all trials stacked, and what
is left, averaged over the trials, is called cogging. It is biased: alpha's torque and cogging live
at the same orders, and the least squares gives some of the cogging to alpha. Kept to compare with.
"""

from dataclasses import dataclass

import numpy as np

from motord.config import MotorConfig
from motord.identify import IdentifyError
from motord.identify.encoder_points import EncoderSums, fill_gaps
from motord.identify.points import Samples


@dataclass(frozen=True)
class ResidualFit:
    """alpha, beta_A (3,) with least-squares standard errors, which do not know of the bias.

    z_Nm (counts,): cogging torque; line (n,): its complex amplitude at each order asked for, with
    the standard error of each over the trials; condition_number of X.
    """

    alpha: np.ndarray
    beta_A: np.ndarray
    alpha_stderr: np.ndarray
    beta_stderr_A: np.ndarray
    z_Nm: np.ndarray
    line: np.ndarray
    line_stderr_Nm: np.ndarray
    condition_number: float


class ResidualEstimator:
    """Takes trial by trial; memory does not grow with their length.

    X = [I* o K, K] (4.6) is never stacked: pinv(X) tau = pinv(X'X) X' tau.
    """

    def __init__(self, motor: MotorConfig, orders: tuple[int, ...]) -> None:
        self._k = motor.back_emf_table()
        self._orders = np.array(orders, int)
        self._xx = np.zeros((6, 6))
        self._xt = np.zeros(6)
        self._tt = 0.0
        self._rows = 0
        self._sums = np.zeros((motor.counts, 7))
        self._trials = np.zeros(motor.counts, int)
        self._lines: list[np.ndarray] = []

    def add(self, samples: Samples) -> None:
        """Take a trial: 24 turns recorded are 23 whole ones from the zero point."""
        whole = samples.whole
        count, counts = samples.count[whole], self._k.shape[0]
        currents = EncoderSums.of(count, samples.i_A[whole], counts)
        torque = EncoderSums.of(count, samples.torque_Nm[whole, None], counts)
        hit, torque_Nm = torque.hits > 0, torque.means()[:, 0]
        torque_Nm -= torque_Nm[hit].mean()  # the sensor does not see the mean
        x = np.concatenate([currents.means() * self._k, self._k], axis=1)  # (4.6)
        self._xx += x[hit].T @ x[hit]
        self._xt += x[hit].T @ torque_Nm[hit]
        self._tt += float(torque_Nm[hit] @ torque_Nm[hit])
        self._rows += int(hit.sum())
        table = np.column_stack([x, torque_Nm])
        self._sums[hit] += table[hit]
        self._trials += hit
        filled = np.column_stack([fill_gaps(column) for column in table.T])
        lines = np.fft.rfft(filled, axis=0)[self._orders] * 2 / filled.shape[0]
        self._lines.append(lines)

    def solve(self) -> ResidualFit:
        """Return y (4.7) as alpha and beta (4.12, 4.13; delta epsilon = 1), and z (4.14)."""
        if not self._lines:
            raise IdentifyError("no operating points to identify from")
        inverse = np.linalg.pinv(self._xx, rcond=1e-12, hermitian=True)
        y = inverse @ self._xt
        variance = (self._tt - self._xt @ y) / max(self._rows - 6, 1)
        stderr = np.sqrt(np.maximum(np.diag(inverse) * variance, 0))
        with np.errstate(invalid="ignore"):
            mean = self._sums / self._trials[:, None]
        z_Nm = fill_gaps(mean[:, 6] - mean[:, :6] @ y)
        lines = np.array([line[:, 6] - line[:, :6] @ y for line in self._lines])
        values = np.linalg.eigvalsh(self._xx)
        kept = values[values > 1e-12 * values[-1]]
        return ResidualFit(
            alpha=1 + y[:3],
            beta_A=y[3:],
            alpha_stderr=stderr[:3],
            beta_stderr_A=stderr[3:],
            z_Nm=z_Nm - z_Nm.mean(),
            line=lines.mean(axis=0),
            line_stderr_Nm=lines.std(axis=0) / np.sqrt(2 * max(len(lines) - 1, 1)),
            condition_number=float(np.sqrt(values[-1] / kept[0])),
        )
