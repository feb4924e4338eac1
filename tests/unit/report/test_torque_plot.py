"""Torque over a turn and its spectrum: what is written below them can be read."""

from itertools import pairwise

import numpy as np
import pytest

from motord.report.plots.torque import TorqueCurve, over_angle_and_order


@pytest.mark.parametrize(("pole_pairs", "orders"), [(1, 12), (8, 120), (8, 320), (4, 999)])
def test_numbers_of_the_orders_do_not_overlap(pole_pairs: int, orders: int) -> None:
    order = np.arange(1, orders + 1)
    angle_rad = np.linspace(0, 2 * np.pi, 100)
    flat = TorqueCurve(angle_rad, np.sin(angle_rad), order, np.full(orders, 1e-3))
    picture = over_angle_and_order(None, flat, range(pole_pairs, orders + 1, pole_pairs))
    picture.draw_without_rendering()
    spectrum = picture.axes[1]
    labels = [one for one in spectrum.get_xticklabels() if one.get_text()]
    boxes = [one.get_window_extent() for one in labels]
    assert len(boxes) >= 8
    assert all(left.x1 < right.x0 for left, right in pairwise(boxes))
    assert all(int(one.get_text()) % pole_pairs == 0 for one in labels)


@pytest.mark.parametrize("largest_Nm", [3.3e-5, 0.33, 330.0])
def test_the_spectrum_shows_four_decades_of_a_motor_of_any_size(largest_Nm: float) -> None:
    angle_rad, order = np.linspace(0, 2 * np.pi, 100), np.arange(1, 65)
    curve = TorqueCurve(angle_rad, np.sin(angle_rad), order, largest_Nm / order)
    low, _ = over_angle_and_order(curve, None, [48]).axes[1].get_ylim()
    assert low == pytest.approx(largest_Nm / 3.3 * 1e-4)
