"""A short part of `tests.campaigns.interlock_search`."""

from collections import Counter

import pytest

from tests.campaigns.interlock_search import play


@pytest.mark.parametrize("seeds", [range(1, 31), (60, 67, 139, 148, 263, 11013, 82000499)])
def test_interlocks_keep_their_times_on_random_legal_benches(seeds: range | tuple[int]) -> None:
    """The last seeds found an `enable_timeout_s` too short, the speed limit to let enable, and
    tracks that seemed stuck after a gap in the samples of a rotor that gains speed."""
    refused: Counter[str] = Counter()
    played = [play(seed, refused) for seed in seeds]
    assert sum(map(bool, played)) > len(played) // 2
    assert len(refused) > 3
