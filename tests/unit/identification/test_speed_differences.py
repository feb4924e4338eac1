"""Lines that differ between speeds: by an age, by an angle that slips, by a gain, or by noise."""

import numpy as np
import pytest

from motord.identification.speed_differences import SpeedDifferences, speed_differences

ORDER = np.array([16, 48, 96])
LINE_NM = np.array([0.08, 0.33j, -0.06])
STDERR_NM = 2e-4
SPEEDS_HZ = (0.5, 0.7, 0.9)


def found(
    speeds_Hz: tuple[float, ...] = SPEEDS_HZ,
    *,
    age_s: float = 0.0,
    shift_rad: tuple[float, ...] | float = 0.0,
    gain: tuple[float, ...] | float = 0.0,
    friction_Nm: float = 0.0,
    seed: int = 1,
) -> SpeedDifferences:
    """What noisy lines differ by; friction turns its sign with the direction."""
    velocity = 2 * np.pi * np.array(speeds_Hz)
    turned_rad = velocity * age_s + np.broadcast_to(shift_rad, velocity.size)
    lines = LINE_NM + friction_Nm * np.sign(velocity)[:, None]
    lines = lines * np.exp(-1j * np.outer(turned_rad, ORDER))
    lines = lines * (1 + np.broadcast_to(gain, velocity.size)[:, None])
    noise = np.random.default_rng(seed).normal(0, STDERR_NM, (2, *lines.shape))
    stderr = np.full(lines.shape, STDERR_NM)
    return speed_differences(lines + noise[0] + 1j * noise[1], stderr, ORDER, velocity, 60)


def named(differences: SpeedDifferences) -> list[str]:
    names = ("age_s", "shift_rad", "gain")
    return [name for name in names if getattr(differences, name).significant]


@pytest.mark.parametrize("age_s", [1e-3, -1e-4])
@pytest.mark.parametrize("speeds_Hz", [SPEEDS_HZ, (0.5, 0.9, -0.5, -0.9)])
def test_an_age_is_found_in_both_directions(speeds_Hz: tuple[float, ...], age_s: float) -> None:
    apart = found(speeds_Hz, age_s=age_s, friction_Nm=0.01)
    assert named(apart) == ["age_s"]
    assert apart.age_s.size == pytest.approx(age_s, abs=2e-5)


def test_an_angle_that_slips_and_a_gain_that_drifts_are_no_age() -> None:
    slipped = found(shift_rad=(0.0, 2e-3, 0.0))
    assert named(slipped) == ["shift_rad"]
    assert 0.5e-3 < slipped.shift_rad.size < 2e-3
    drifted = found(gain=(0.0, 0.005, 0.01))
    assert named(drifted) == ["gain"]
    assert drifted.gain.size == pytest.approx(0.005, rel=0.4)


@pytest.mark.parametrize("speeds_Hz", [SPEEDS_HZ, (*SPEEDS_HZ, *(-one for one in SPEEDS_HZ))])
@pytest.mark.parametrize("kind", ["gain", "shift_rad"])
def test_means_hold_what_differs_by_chance_and_are_as_sharp_without(
    kind: str, speeds_Hz: tuple[float, ...]
) -> None:
    """5e-3 from speed to speed, of which noise makes a tenth at most."""
    rng, held, clean = np.random.default_rng(4), [], []
    for seed in range(200):
        sizes = 5e-3 * rng.standard_normal(len(speeds_Hz))
        one = getattr(found(speeds_Hz, seed=seed, **{kind: tuple(sizes)}), kind)
        held.append(abs(sizes.mean()) < one.half_width)
        clean.append(getattr(found(speeds_Hz, seed=seed), kind).half_width)
    assert 0.9 < np.mean(held) < 0.99
    assert np.median(clean) == 0.0


def test_a_speed_that_is_all_but_exact_leaves_what_the_others_differ_by() -> None:
    stderr = np.full((3, ORDER.size), STDERR_NM)
    stderr[1] = 1e-13
    lines = LINE_NM * (1 + np.array([[0.0], [0.01], [0.0]]))
    velocity = 2 * np.pi * np.array(SPEEDS_HZ)
    gain = speed_differences(lines, stderr, ORDER, velocity, 60).gain
    assert gain.stderr == pytest.approx(0.01, rel=0.1)


@pytest.mark.parametrize("speeds_Hz", [(0.7,), (0.7, 0.7), (0.7, -0.7)])
def test_one_speed_shows_no_age(speeds_Hz: tuple[float, ...]) -> None:
    assert "age_s" not in named(found(speeds_Hz, age_s=1e-3))


def test_noise_is_rarely_taken_for_a_difference() -> None:
    share = np.mean([bool(named(found(seed=seed))) for seed in range(1000)])
    assert share < 0.012  # three tests of 0.2 % each
