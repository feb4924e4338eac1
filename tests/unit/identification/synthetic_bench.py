"""An independent little test bench with exactly known truth: numpy and scipy only.

Torque passes the sensor on a grid several times finer than the ticks, so that what the estimators
see is sampled from continuous time.
"""

from dataclasses import dataclass, field
from functools import cache

import numpy as np
from scipy import signal

from motord.config import BackEmfHarmonic, MotorConfig, TorqueSensorConfig
from motord.identification.operating_points import PointData

TICKS = np.dtype(
    [
        ("t_ns", "i8"),
        ("tick", "u8"),
        ("encoder_count", "i4"),
        *[(f"i_{p}_A", "f4") for p in "abc"],
        *[(f"i_cmd_{p}_A", "f4") for p in "abc"],
        ("torque_Nm", "f4"),
        ("i_age_ns", "i4"),
        ("plan_point", "i4"),
    ]
)


def motor(
    slots: int = 48,
    pole_pairs: int = 8,
    counts: int = 4096,
    connection: str = "independent",
    third: float = 0.0,
) -> MotorConfig:
    harmonics = [BackEmfHarmonic(order=1, amplitude_V_s_per_rad=0.206)]
    if third:
        harmonics.append(BackEmfHarmonic(order=3, amplitude_V_s_per_rad=0.206 * third))
    harmonics.append(BackEmfHarmonic(order=5, amplitude_V_s_per_rad=0.004, phase_rad=0.4))
    return MotorConfig(
        name=f"{slots}/{2 * pole_pairs}",
        pole_pairs=pole_pairs,
        slots=slots,
        counts=counts,
        rated_torque_Nm=6.0,
        connection=connection,
        back_emf=tuple(harmonics),
    )


@dataclass(frozen=True)
class Truth:
    """What the bench really is."""

    alpha: tuple[float, float, float] = (0.8, 1.118, 1.118)
    beta_A: tuple[float, float, float] = (1.0, -0.5, -0.5)
    delta: float = 1.0
    cogging: dict[int, tuple[float, float]] = field(  # order: (amplitude_Nm, phase_rad), sine
        default_factory=lambda: {16: (0.08, 0.3), 32: (0.02, 1.0), 48: (0.1, -0.5), 96: (0.03, 2.0)}
    )

    def cogging_Nm(self, angle_rad: np.ndarray) -> np.ndarray:
        return sum(
            (a * np.sin(h * angle_rad + phase) for h, (a, phase) in self.cogging.items()),
            np.zeros_like(angle_rad),
        )


SENSOR = TorqueSensorConfig(highpass_time_constant_s=2.0, resonance_Hz=700.0, damping_ratio=0.02)


@cache
def _discrete(system: tuple[tuple[float, ...], ...], dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return numerator and denominator of a system in steps of `dt`."""
    numerator, denominator, _ = signal.cont2discrete(system, dt, "foh")
    return numerator.ravel(), denominator


@dataclass(frozen=True)
class Bench:
    """Motor, sensor, truth, and how it is sampled."""

    motor: MotorConfig = field(default_factory=motor)
    truth: Truth = Truth()
    sensor: TorqueSensorConfig = SENSOR
    rate_Hz: int = 1000
    torque_noise_Nm: float = 0.05
    current_noise_A: float = 0.05
    drift_Nm: float = 0.02
    speed_ripple: float = 0.1
    ripple_order: int = 16
    lag_s: float = 0.0004
    i_age_s: float = 0.0
    fine_Hz: int = 4_000
    gain_scatter: float = 0.0
    """Standard deviation of each phase's gain from point to point, in parts of it."""

    def point(
        self, torque_Nm: float, speed_Hz: float, turns: float, seed: int, calibration: object = None
    ) -> PointData:
        """Turn `turns` turns at a set-point from an arbitrary angle."""
        rng = np.random.default_rng(seed)
        fine = max(4, int(np.ceil(self.fine_Hz / self.rate_Hz)))
        warm_s = 0.5 / speed_Hz
        n = int((turns / speed_Hz + warm_s) * self.rate_Hz) * fine
        t_s = np.arange(n) / (self.rate_Hz * fine)
        angle_rad = self._angle(t_s, speed_Hz, rng)
        late_rad = self._angle_at(t_s, angle_rad, -self.lag_s)
        own = np.random.default_rng([seed, 1]).standard_normal(3)
        alpha = np.array(self.truth.alpha) * (1 + self.gain_scatter * own)
        sensed_A, flowing_A = self._currents(late_rad, torque_Nm, calibration, alpha)
        k = self._back_emf(angle_rad)
        torque_true = (flowing_A * k).sum(axis=1) + self.truth.cogging_Nm(angle_rad)
        torque_seen = self.truth.delta * self._through_sensor(torque_true, t_s)
        age = round(self.i_age_s * self.rate_Hz * fine)
        taken = np.arange(int(warm_s * self.rate_Hz) * fine, n, fine)
        ticks = np.zeros(taken.size, TICKS)
        ticks["t_ns"] = 1_000_000_000 + np.round(t_s[taken] * 1e9).astype(np.int64)
        ticks["tick"] = 100_000 * seed + np.arange(taken.size)
        ticks["encoder_count"] = self._count(angle_rad[taken])
        ticks["i_age_ns"] = round(age / (self.rate_Hz * fine) * 1e9)
        noise_A = self.current_noise_A * rng.standard_normal((taken.size, 3))
        command_A = self._command(angle_rad[taken], k[taken], torque_Nm, calibration)
        for p in range(3):
            ticks[f"i_{'abc'[p]}_A"] = sensed_A[taken - age, p] + noise_A[:, p]
            ticks[f"i_cmd_{'abc'[p]}_A"] = command_A[:, p]
        drift = np.cumsum(rng.standard_normal(taken.size)) / np.sqrt(self.rate_Hz) * self.drift_Nm
        noise = self.torque_noise_Nm * rng.standard_normal(taken.size)
        ticks["torque_Nm"] = torque_seen[taken] + noise + drift + 0.7
        return PointData(torque_Nm, speed_Hz, ticks)

    def mesh(
        self,
        torques_Nm: tuple[float, ...] = (1.0, 4.0),
        speeds_Hz: tuple[float, ...] = (0.6, 1.0),
        turns: float = 8,
        seed: int = 1,
        calibration: object = None,
    ) -> list[PointData]:
        """Take a mesh of operating points."""
        pairs = [(torque, speed) for torque in torques_Nm for speed in speeds_Hz]
        return [
            self.point(torque, speed, turns, 1000 * seed + row, calibration)
            for row, (torque, speed) in enumerate(pairs)
        ]

    def _angle(self, t_s: np.ndarray, speed_Hz: float, rng: np.random.Generator) -> np.ndarray:
        """Return the angle with a speed that ripples with position."""
        start_rad, phase = rng.uniform(0, 2 * np.pi, 2)
        uniform = np.linspace(-1, 2 * np.pi * speed_Hz * t_s[-1] * 1.5 + 10, 2 * t_s.size)
        pace = 1 / (1 + self.speed_ripple * np.cos(self.ripple_order * uniform + phase))
        time = np.concatenate([[0.0], np.cumsum((pace[1:] + pace[:-1]) / 2 * np.diff(uniform))])
        time = (time - np.interp(0.0, uniform, time)) / (2 * np.pi * speed_Hz)
        return np.interp(t_s, time, uniform) + start_rad

    @staticmethod
    def _angle_at(t_s: np.ndarray, angle_rad: np.ndarray, shift_s: float) -> np.ndarray:
        speed = np.gradient(angle_rad, t_s)
        return angle_rad + speed * shift_s

    def _back_emf(self, angle_rad: np.ndarray) -> np.ndarray:
        """Return k (n, 3) from the harmonics, not from the table."""
        waves, parts = [], []
        for h in self.motor.back_emf:
            turned_rad = h.order * self.motor.pole_pairs * angle_rad
            waves += [np.sin(turned_rad), np.cos(turned_rad)]
            phase_rad = h.phase_rad - h.order * 2 * np.pi / 3 * np.arange(3)
            parts += [h.amplitude_V_s_per_rad * wave(phase_rad) for wave in (np.cos, np.sin)]
        return (np.array(parts).T @ np.array(waves)).T  # phases one after the other: sums are quick

    def _command(
        self, angle_rad: np.ndarray, k: np.ndarray, torque_Nm: float, calibration: object
    ) -> np.ndarray:
        """Return commanded currents (n, 3) at angles (n,) with a back-EMF k (n, 3)."""
        if self.motor.connection == "star":
            k = k - k.mean(axis=1, keepdims=True)
        wanted = np.full(angle_rad.size, torque_Nm)
        alpha, beta, gain = np.ones(3), np.zeros(3), 1.0
        if calibration is not None:
            alpha, beta = np.array(calibration.alpha), np.array(calibration.beta_A)
            gain = calibration.delta_epsilon
            table = np.asarray(calibration.tau_cog_Nm)
            turn = np.append(table, table[0])
            position = (angle_rad / (2 * np.pi) % 1) * table.size
            wanted = wanted - np.interp(position, np.arange(turn.size), turn)
        i_A = wanted[:, None] * k / (k**2).sum(axis=1, keepdims=True)
        return (i_A - beta) / (alpha * gain)

    def _currents(
        self, angle_rad: np.ndarray, torque_Nm: float, calibration: object, alpha: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return (sensed, flowing) currents with gains `alpha` (3,)."""
        beta = np.array(self.truth.beta_A)
        sensed = self._command(angle_rad, self._back_emf(angle_rad), torque_Nm, calibration)
        if self.motor.connection == "star":
            surplus = (alpha * sensed + beta).sum(axis=1, keepdims=True)
            sensed = sensed - surplus / alpha.sum()
        return sensed, alpha * sensed + beta

    def _through_sensor(self, torque_Nm: np.ndarray, t_s: np.ndarray) -> np.ndarray:
        sensor, seen = self.sensor, torque_Nm
        dt = t_s[1] - t_s[0]
        if sensor.resonance_Hz:
            w = 2 * np.pi * sensor.resonance_Hz
            seen = self._filter(([w * w], [1, 2 * sensor.damping_ratio * w, w * w]), seen, dt)
        if sensor.highpass_time_constant_s:
            tau = sensor.highpass_time_constant_s
            seen = self._filter(([tau, 0], [tau, 1]), seen - seen.mean(), dt)
        return seen

    @staticmethod
    def _filter(system: tuple[list[float], list[float]], x: np.ndarray, dt: float) -> np.ndarray:
        b, a = _discrete(tuple(map(tuple, system)), dt)
        state = signal.lfilter_zi(b, a) * x[0] if abs(a.sum()) > 1e-12 else None
        return signal.lfilter(b, a, x, zi=state)[0]

    def _count(self, angle_rad: np.ndarray) -> np.ndarray:
        counts = self.motor.counts
        return np.rint(angle_rad / (2 * np.pi) * counts).astype(np.int64) % counts

    def true_rms_percent(self, torque_Nm: float, calibration: object) -> float:
        """RMS error (4.16) over one turn of what the motor makes, currents without lag."""
        angle_rad = np.linspace(0, 2 * np.pi, 20_000, endpoint=False)
        alpha = np.array(self.truth.alpha)
        _, flowing_A = self._currents(angle_rad, torque_Nm, calibration, alpha)
        torque = (flowing_A * self._back_emf(angle_rad)).sum(axis=1)
        torque = torque + self.truth.cogging_Nm(angle_rad)
        return float(100 * torque.std() / self.motor.rated_torque_Nm)
