"""Where a recording holds releases: after stillness, until the next."""

import numpy as np

from motord.experiments.inertia.releases import find_releases
from motord.identification.rotor.log_decrement import find_free_oscillation

COUNTS = 4096


def history(hold_s: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """At rest, pulled, held, let go; twice; rest is at count 10, so the swing passes zero."""
    t_s = np.arange(0, 0.5, 1e-3)
    rest = np.full(500, 10.0)
    pull = 10 + 100 * np.linspace(0, 1, 300)
    held = np.full(round(hold_s * 1000), 110.0)
    t_s = np.arange(0, 1.5, 1e-3)
    oscillation = 10 + 100 * np.exp(-2.0 * t_s) * np.cos(47 * t_s)
    once = np.concatenate([rest, pull, held, oscillation, rest])
    count = np.rint(np.concatenate([once, once])).astype(int) % COUNTS
    return 10**18 + np.arange(count.size) * 1_000_000, count


def test_each_swing_is_found_and_can_be_read() -> None:
    t_ns, count = history()
    parts = find_releases(t_ns, count, COUNTS)
    swings = [part for part in parts if np.ptp((count[part] + 2048) % COUNTS) > 150]
    assert len(swings) == 2
    for part in swings:
        oscillation = find_free_oscillation(t_ns[part], count[part], COUNTS)
        assert abs(2 * np.pi / np.mean(np.diff(oscillation.crossings_s)) / 2 - 47) < 0.2


def test_a_recording_that_begins_with_the_release_is_one_stretch() -> None:
    t_s = np.arange(0, 0.4, 1e-3)
    count = np.rint(2000 + 100 * np.cos(47 * t_s)).astype(int)
    assert find_releases(np.arange(400) * 1_000_000, count, COUNTS) == [slice(0, 400)]


def test_a_bar_that_never_moves_is_let_go_nowhere() -> None:
    assert find_releases(np.arange(300) * 1_000_000, np.full(300, 7), COUNTS) == []
