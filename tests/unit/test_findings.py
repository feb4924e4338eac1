"""Texts of findings."""

import pytest

from motord.findings import listed


@pytest.mark.parametrize(
    ("count", "most", "text"),
    [(1, 1, "0"), (2, 1, "0 and 1 more"), (4, 4, "0; 1; 2; 3"), (6, 4, "0; 1; 2; 3 and 2 more")],
)
def test_of_many_the_first_are_listed(count: int, most: int, text: str) -> None:
    assert listed([str(n) for n in range(count)], most) == text
    assert listed([str(n // 2) for n in range(2 * count)], most) == text
