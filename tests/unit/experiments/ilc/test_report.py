"""The page of learning: numbers of passes that can be read, however many there are."""

from itertools import pairwise

import pytest

from motord.experiments.ilc.report import convergence


@pytest.mark.parametrize("passes", [1, 2, 5, 15, 40, 50])
def test_numbers_of_passes_do_not_overlap_and_are_of_passes(passes: int) -> None:
    picture = convergence({(3.0, 0.7): (1.0,) * passes})
    picture.draw_without_rendering()
    labels = picture.axes[0].get_xticklabels()
    boxes = [label.get_window_extent() for label in labels]
    assert all(left.x1 < right.x0 for left, right in pairwise(boxes))
    numbers = [int(label.get_text()) for label in labels]
    assert numbers[0] == 1
    assert passes - 4 < numbers[-1] <= passes
