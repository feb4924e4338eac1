"""Texts of findings."""

import pytest

from motord.findings import listed


@pytest.mark.parametrize(
    ("count", "most", "text"),
    [(1, 1, "0"), (2, 1, "0 and 1 more"), (4, 4, "0; 1; 2; 3"), (6, 4, "0; 1; 2; 3 and 2 more")],
)
def test_of_many_the_first_are_listed(count: int, most: int, text: str) -> None:
    assert listed([str(n) for n in range(count)], most) == text


def test_a_text_that_comes_again_is_listed_once_with_how_many_times() -> None:
    assert listed(["a", "b", "a", "a", "c"], 2) == "a (3 times); b and 1 more"
