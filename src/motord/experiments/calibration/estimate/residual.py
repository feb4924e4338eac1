"""The residual estimator of the report: Poels 2008, eq. (4.5) to (4.14).

Averages over the turns at each encoder point, one pseudo-inverse for all trials stacked, and the
residual, averaged over the trials, is called cogging. It is biased: alpha's torque and cogging live
at the same orders, and the least squares gives some of the cogging to alpha. Kept to compare with.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motord.calibration import Harmonic
from motord.config import MotorConfig
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.findings import Finding
from motord.identification import IdentifyError
from motord.identification.operating_points import Samples
from motord.identification.point_ripple import PointRipple
from motord.identification.resample import fill_gaps
from motord.jit import jit_sums


@dataclass(frozen=True)
class Trial:
    """Averages of one operating point: rows i_a, i_b, i_c (A), torque (Nm), 1 where there are any.

    table: (5, counts); all rows are 0 at encoder points without a sample, and the mean of the
    torque is 0, because the sensor does not see it.
    """

    table: np.ndarray

    @classmethod
    def of(cls, samples: Samples, counts: int) -> "Trial":
        """Average over the whole turns: 24 recorded are 23 from the zero point."""
        whole = samples.whole
        count, values = samples.count[whole], (*samples.i_A[whole].T, samples.torque_Nm[whole])
        sums = [np.bincount(count, value, counts) for value in values]
        hits = np.bincount(count, minlength=counts)
        hit = hits > 0
        table = np.zeros((5, counts))
        np.divide(sums, hits, out=table[:4], where=hit)
        table[3, hit] -= table[3, hit].mean()
        table[4] = hit
        return cls(table)

    def lines(self, k: np.ndarray, orders: np.ndarray) -> np.ndarray:
        """Return the complex amplitudes (n, 7) of the columns of X (4.6) and of the torque."""
        seen = np.where(self.table[4] > 0, self.table[:4], np.nan)
        currents = np.array([fill_gaps(row) for row in seen[:3] * k])
        rows = np.concatenate([currents, k, fill_gaps(seen[3])[None]])
        return np.asarray(np.fft.rfft(rows, axis=1)[:, orders].T * 2 / k.shape[1])


class ResidualEstimator:
    """Takes trial by trial; memory does not grow with their length.

    X = [I* o K, K] (4.6) is never stacked: pinv(X) tau = pinv(X'X) X' tau.
    """

    def __init__(self, motor: MotorConfig, orders: tuple[int, ...]) -> None:
        self._k = np.ascontiguousarray(motor.back_emf_table().T)
        self._orders = np.array(orders, int)
        self._products = np.zeros((7, 7))  # of the columns of X and the torque
        self._sums = np.zeros((5, motor.counts))
        self._trials: list[Trial] = []

    def add(self, samples: Samples) -> None:
        """Take an operating point."""
        self.take(Trial.of(samples, self._k.shape[1]))

    def take(self, trial: Trial) -> None:
        """Take the averages of an operating point."""
        add_trial_products(trial.table, self._k, self._products)
        self._sums += trial.table
        self._trials.append(trial)

    def least_squares(self) -> tuple[np.ndarray, np.ndarray]:
        """Return y (6,), eq. (4.7), and the residual, averaged over the trials (counts,), (4.14).

        Encoder points without any sample are filled from their neighbours.
        """
        if not self._trials:
            raise IdentifyError("no operating points to identify from")
        products = self._products
        inverse = np.linalg.pinv(products[:6, :6], rcond=1e-12, hermitian=True)
        y = inverse @ products[:6, 6]
        with np.errstate(invalid="ignore"):
            means = self._sums[:4] / self._sums[4]
        residual_Nm = means[3] - y[:3] @ (means[:3] * self._k) - y[3:] @ self._k
        return y, fill_gaps(residual_Nm)

    def solve(self, ripples: Sequence[PointRipple] = ()) -> CalibrationResult:
        """Return y (4.7) as alpha and beta (4.12, 4.13; delta epsilon = 1), and z (4.14).

        The standard errors, of least squares, do not know of the bias; those of the cogging torque
        are over the trials; one trial has none. ripples: of the operating points.
        Raises IdentifyError.
        """
        y, z_Nm = self.least_squares()
        products = self._products
        xx, xt, tt = products[:6, :6], products[:6, 6], products[6, 6]
        rows = int(self._sums[4].sum())
        variance = (tt - xt @ y) / max(rows - 6, 1)
        inverse = np.linalg.pinv(xx, rcond=1e-12, hermitian=True)
        stderr = np.sqrt(np.maximum(np.diag(inverse) * variance, 0))
        values = np.linalg.eigvalsh(xx)
        kept = values[values > 1e-12 * values[-1]]
        return CalibrationResult(
            method="residual",
            alpha=1 + y[:3],
            alpha_stderr=stderr[:3],
            beta_A=y[3:],
            beta_stderr_A=stderr[3:],
            delta_epsilon=1.0,
            delta_epsilon_stderr=None,
            tau_cog_Nm=z_Nm - z_Nm.mean(),
            harmonics=self._harmonics(y),
            observable=(
                "alpha and cogging torque have the same orders: this estimator gives some of the "
                "one to the other, and its standard errors do not know of it",
                "common gain delta epsilon: assumed to be 1",
            ),
            condition_number=float(np.sqrt(values[-1] / kept[0])),
            ripples=tuple(ripples),
            findings=_one_trial() if len(self._trials) < 2 else (),
        )

    def _harmonics(self, y: np.ndarray) -> tuple[Harmonic, ...]:
        """Return the torque less that of `y` (6,), at the orders of the cogging torque."""
        parts = [trial.lines(self._k, self._orders) for trial in self._trials]
        lines = np.array([part[:, 6] - part[:, :6] @ y for part in parts])
        known = len(lines) > 1
        stderr_Nm = lines.std(axis=0) / np.sqrt(2 * max(len(lines) - 1, 1))
        return tuple(
            Harmonic(
                order=int(order),
                amplitude_Nm=float(np.abs(line)),
                phase_rad=float(np.angle(line * 1j)),
                stderr_Nm=float(stderr) if known else None,
            )
            for order, line, stderr in zip(self._orders, lines.mean(axis=0), stderr_Nm, strict=True)
        )


def _one_trial() -> tuple[Finding, ...]:
    return (
        Finding(
            "one-trial", 1, 2, "trials", "warning",
            "the error of the cogging torque is that between trials: it is not known from one",
            "take two operating points or more, or the joint estimator",
        ),
    )  # fmt: skip


@jit_sums
def add_trial_products(table: np.ndarray, k: np.ndarray, products: np.ndarray) -> None:
    """Add the products of all pairs of columns of X and the torque to `products` (7, 7).

    table (5, counts) as in `Trial`; k (3, counts). The columns a, b, c = I* o K, d, e, f = K and
    t, the torque, are never made: one pass over the encoder points, all sums at once. To make them
    for `basis.add_products` takes longer than these sums.
    """
    aa = ab = ac = ad = ae = af = at = bb = bc = bd = be = bf = bt = cc = 0.0
    cd = ce = cf = ct = dd = de = df = dt = ee = ef = et = ff = ft = tt = 0.0
    i_a, i_b, i_c, torque, hit = table[0], table[1], table[2], table[3], table[4]
    k_a, k_b, k_c = k[0], k[1], k[2]
    for n in range(torque.size):
        a, b, c, t = i_a[n] * k_a[n], i_b[n] * k_b[n], i_c[n] * k_c[n], torque[n]
        d, e, f = hit[n] * k_a[n], hit[n] * k_b[n], hit[n] * k_c[n]
        aa, ab, ac, ad = aa + a * a, ab + a * b, ac + a * c, ad + a * d
        ae, af, at, bb = ae + a * e, af + a * f, at + a * t, bb + b * b
        bc, bd, be, bf = bc + b * c, bd + b * d, be + b * e, bf + b * f
        bt, cc, cd, ce = bt + b * t, cc + c * c, cd + c * d, ce + c * e
        cf, ct, dd, de = cf + c * f, ct + c * t, dd + d * d, de + d * e
        df, dt, ee, ef = df + d * f, dt + d * t, ee + e * e, ef + e * f
        et, ff, ft, tt = et + e * t, ff + f * f, ft + f * t, tt + t * t
    rows = (
        (aa, ab, ac, ad, ae, af, at),
        (ab, bb, bc, bd, be, bf, bt),
        (ac, bc, cc, cd, ce, cf, ct),
        (ad, bd, cd, dd, de, df, dt),
        (ae, be, ce, de, ee, ef, et),
        (af, bf, cf, df, ef, ff, ft),
        (at, bt, ct, dt, et, ft, tt),
    )
    for p in range(7):
        for q in range(7):
            products[p, q] += rows[p][q]
