"""One oscillation: crossings, decrement and the fit of the whole decay, against known motions."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from motord.identification import IdentifyError
from motord.identification.rotor.free_decay import fit_decay, free_decay_angles, mean_frequency
from motord.identification.rotor.log_decrement import find_free_oscillation, five_periods

COUNTS = 4096
STIFFNESS_NM = 50.0
NO_WAVES = np.zeros((3, 0))


def samples(angle_rad: np.ndarray, counts: int = COUNTS) -> np.ndarray:
    return np.rint(angle_rad * counts / (2 * np.pi)).astype(int) % counts


def times_ns(seconds: float, rate_Hz: int = 1000) -> np.ndarray:
    return 10**18 + np.arange(round(seconds * rate_Hz)) * (10**9 // rate_Hz)


def damped(
    t_ns: np.ndarray, zeta: float = 0.04, period_s: float = 0.1334, rest_rad: float = 1.0
) -> np.ndarray:
    """Held for 0.3 s, then a damped cosine."""
    x_s = np.maximum((t_ns - t_ns[0]) * 1e-9 - 0.3, 0.0)
    w = 2 * np.pi / period_s
    decay = zeta / np.sqrt(1 - zeta**2)
    return rest_rad + 0.17 * np.exp(-decay * w * x_s) * (np.cos(w * x_s) + decay * np.sin(w * x_s))


@pytest.mark.parametrize("counts", [1000, 4096, 20_000])
@pytest.mark.parametrize("rest_rad", [1.0, 0.01, 6.28])
def test_period_and_decrement_of_a_damped_cosine(counts: int, rest_rad: float) -> None:
    t_ns = times_ns(1.6)
    oscillation = find_free_oscillation(
        t_ns, samples(damped(t_ns, rest_rad=rest_rad), counts), counts
    )
    found = five_periods(oscillation)
    assert found.period_s == pytest.approx(0.1334, rel=1e-3 if counts < 2000 else 3e-4)
    assert found.decrement == pytest.approx(2 * np.pi * 0.04, rel=0.06)
    assert (oscillation.rest_rad - rest_rad + np.pi) % (2 * np.pi) - np.pi == pytest.approx(
        0, abs=2e-3
    )
    w = found.frequency_rad_s()
    assert w > found.frequency_rad_s(damped=False)
    assert found.frequency_rad_s(cubic_per_rad2=-0.5) > w


def integrated(t_s: np.ndarray, p: np.ndarray, waves: np.ndarray = NO_WAVES) -> np.ndarray:
    angle_rad = np.empty_like(t_s)
    free_decay_angles(t_s, p, waves, angle_rad)
    return angle_rad


PARAMETERS = np.array([0.16, 0.0, 2.0, 47.0**2, 0.2, 4.0, 1.3])


@pytest.mark.kernel
def test_the_motion_is_what_solve_ivp_integrates() -> None:
    t_s = np.linspace(0, 0.3, 301)
    waves = np.array([[48.0], [10.0], [4.0]])
    x0, v0, rest, w2, tension, viscous, coulomb = PARAMETERS

    def slope(_: float, y: np.ndarray) -> list[float]:
        pull = -w2 * np.sin(y[0]) * np.cos(y[0]) * (1 + tension * y[0] ** 2)
        cogging = 10 * np.cos(48 * (rest + y[0])) + 4 * np.sin(48 * (rest + y[0]))
        friction = viscous * y[1] + coulomb * np.tanh(y[1] / 1e-4)
        return [y[1], pull + cogging - friction]

    expected = solve_ivp(
        slope, (0, 0.3), [x0, v0], t_eval=t_s, rtol=1e-9, atol=1e-11, method="LSODA"
    ).y[0]
    np.testing.assert_allclose(integrated(t_s, PARAMETERS, waves), rest + expected, atol=2e-5)


@pytest.mark.kernel
def test_gaps_between_samples_are_integrated_through() -> None:
    t_s = np.linspace(0, 0.2, 201)
    few = np.concatenate([t_s[:20], t_s[60::7]])
    whole = integrated(t_s, PARAMETERS)
    expected = np.concatenate([whole[:20], whole[60::7]])
    np.testing.assert_allclose(integrated(few, PARAMETERS), expected, atol=1e-6)


def released(p: np.ndarray, waves: np.ndarray = NO_WAVES, seconds: float = 1.4) -> np.ndarray:
    held = np.full(300, p[2] + p[0])
    return np.concatenate([held, integrated(np.arange(round(seconds * 1000)) / 1000, p, waves)])


def test_the_fit_finds_frequency_friction_and_what_tension_does() -> None:
    angle_rad = released(PARAMETERS)
    t_ns = times_ns(angle_rad.size / 1000)
    found = fit_decay(find_free_oscillation(t_ns, samples(angle_rad), COUNTS), STIFFNESS_NM)
    assert found.frequency_rad_s == pytest.approx(47.0, abs=4 * found.frequency_stderr_rad_s)
    assert found.frequency_stderr_rad_s < 2e-4 * 47
    assert found.cubic_per_rad2 == pytest.approx(0.2 - 2 / 3, abs=0.05)
    assert found.viscous_per_s == pytest.approx(4.0, rel=0.02)
    assert found.coulomb_rad_s2 == pytest.approx(1.3, rel=0.2)
    assert found.rest_rad == pytest.approx(2.0, abs=2e-4)
    assert 0.2 < found.residual_rad.std() * COUNTS / (2 * np.pi) < 0.4  # rounding: 0.29


def test_known_cogging_torque_is_taken_into_account() -> None:
    torque_Nm = np.array([[16.0, 48.0], [0.05, 0.2], [-0.03, 0.26]])
    waves = torque_Nm * np.array([[1.0], [47.0**2 / STIFFNESS_NM], [47.0**2 / STIFFNESS_NM]])
    angle_rad = released(PARAMETERS, waves)
    oscillation = find_free_oscillation(times_ns(angle_rad.size / 1000), samples(angle_rad), COUNTS)
    known = fit_decay(oscillation, STIFFNESS_NM, torque_Nm)
    assert known.frequency_rad_s == pytest.approx(47.0, rel=3e-4)
    ignored = fit_decay(oscillation, STIFFNESS_NM)
    assert abs(ignored.frequency_rad_s / 47 - 1) > 2e-3


def test_rounding_does_not_average_out() -> None:
    angle_rad = released(PARAMETERS)
    oscillation = find_free_oscillation(times_ns(angle_rad.size / 1000), samples(angle_rad), COUNTS)
    one = fit_decay(oscillation, STIFFNESS_NM)
    mean, error = mean_frequency([one, one, one])
    assert mean == pytest.approx(one.frequency_rad_s)
    assert error == pytest.approx(one.frequency_stderr_rad_s)


def test_late_and_repeated_samples_do_no_harm() -> None:
    t_ns = times_ns(1.6)
    count = samples(damped(t_ns))
    clean = five_periods(find_free_oscillation(t_ns, count, COUNTS))
    order = np.sort(np.concatenate([np.arange(t_ns.size), np.arange(0, t_ns.size, 9)]))
    again = five_periods(find_free_oscillation(t_ns[order], count[order], COUNTS))
    assert again == clean
    fewer = np.delete(np.arange(t_ns.size), np.arange(500, 520))
    lost = five_periods(find_free_oscillation(t_ns[fewer], count[fewer], COUNTS))
    assert lost.period_s == pytest.approx(0.1334, rel=1e-3)


@pytest.mark.parametrize(
    ("angle_rad", "message"),
    [
        (lambda t_ns: np.full(t_ns.size, 1.0), "hardly moves"),
        (lambda t_ns: damped(t_ns, zeta=0.3), "periods only, 5.5 are needed"),
        (lambda t_ns: damped(t_ns[:20]), "20 samples only"),
        (lambda t_ns: np.linspace(0, 1, t_ns.size), "periods only"),
        (lambda t_ns: np.where(np.arange(t_ns.size) < 300, 1.0, 1.2), "for 0 periods only"),
    ],
)
def test_what_is_no_swing_is_refused(angle_rad, message: str) -> None:
    t_ns = times_ns(1.6)
    angles = angle_rad(t_ns)
    with pytest.raises(IdentifyError, match=message):
        find_free_oscillation(t_ns[: angles.size], samples(angles), COUNTS)


def test_too_slow_a_loop_is_refused() -> None:
    t_ns = times_ns(1.6, 100)
    with pytest.raises(IdentifyError, match="too few samples a period"):
        find_free_oscillation(t_ns, samples(damped(t_ns)), COUNTS)


def test_a_swing_about_a_rest_that_moves_is_refused() -> None:
    t_ns = times_ns(1.6)
    oscillation = find_free_oscillation(t_ns, samples(damped(t_ns)), COUNTS)
    rng = np.random.default_rng(1)
    object.__setattr__(
        oscillation,
        "angle_rad",
        oscillation.angle_rad + 0.1 * rng.normal(size=oscillation.t_s.size),
    )
    with pytest.raises(IdentifyError, match="could not be fitted"):
        fit_decay(oscillation, STIFFNESS_NM)
