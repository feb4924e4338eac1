"""Torque of a cycle: of the sensor above its high-pass, of the currents below."""

from math import exp

import numpy as np

from motord.calibration import Calibration
from motord.experiments.subject import Subject
from motord.identification.operating_points import CURRENTS, stacked


def torques(ticks: np.ndarray, subject: Subject, calibration: Calibration | None) -> np.ndarray:
    """Return the torque, what the sensor passes of the set torque, and that of the currents (3, n).

    The last is nan where the sensor passes the mean: it is not used then.
    """
    torque_Nm, set_Nm = (ticks[name].astype(float) for name in ("torque_Nm", "torque_set_Nm"))
    tau_s = subject.sensor.highpass_time_constant_s
    if tau_s == 0 or ticks.size < 2:
        return np.array([torque_Nm, set_Nm, np.full(ticks.size, np.nan)])
    currents_Nm = _from_currents(ticks, subject, calibration)
    decay = exp(-float(np.median(np.diff(ticks["t_ns"]))) * 1e-9 / tau_s)
    fast_Nm = _passed(_passed(currents_Nm, decay), decay)
    slow_Nm = currents_Nm - fast_Nm
    return np.array([_passed(torque_Nm, decay) + slow_Nm, _passed(set_Nm, decay), currents_Nm])


def slow_square(t_s: np.ndarray, torque_Nm: np.ndarray, span_s: float) -> float:
    """Return the mean square of a torque's (n,) means over spans of this length."""
    span = ((t_s - t_s[0]) / span_s).astype(np.int64)
    samples = np.bincount(span)
    sums_Nm = np.bincount(span, torque_Nm)
    return float(np.sum(sums_Nm**2 / np.maximum(samples, 1)) / t_s.size)


def _passed(torque_Nm: np.ndarray, decay: float) -> np.ndarray:
    """Return what the high-pass passes of a torque (n,) that was constant before."""
    from scipy.signal import lfilter  # 0.3 s, of whoever asks for less

    start = [decay * torque_Nm[0]]
    return np.asarray(torque_Nm - lfilter([1 - decay], [1, -decay], torque_Nm, zi=start)[0])


def _from_currents(
    ticks: np.ndarray, subject: Subject, calibration: Calibration | None
) -> np.ndarray:
    """Return the torque (n,) of the sensed currents, and cogging if there is a calibration."""
    i_A = stacked(ticks, CURRENTS)
    count, cogging_Nm = ticks["encoder_count"], np.zeros(1)
    if calibration is not None:
        i_A = i_A * (calibration.delta_epsilon * np.array(calibration.alpha))
        i_A = i_A + np.array(calibration.beta_A)
        cogging_Nm = np.array(calibration.tau_cog_Nm)[count]
    return np.asarray((i_A * subject.motor.back_emf_table()[count]).sum(axis=1) + cogging_Nm)
