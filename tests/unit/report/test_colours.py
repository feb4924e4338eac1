"""Colours of pictures: lines stand out on both pages, numbers on the areas that they are on."""

from itertools import pairwise

import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgb

from motord.report.html import inline
from motord.report.plots.mesh import RANGE_PERCENT, rms_error
from motord.report.style import ON_FILL, PALETTE, luminance, steps

LINES = ["ink", "soft", "before", "after", "reference", "serious", *(f"step{n}" for n in range(8))]
GRAPHICS_MIN, TEXT_MIN = 3.0, 4.5
"""WCAG 2.2, success criteria 1.4.11 and 1.4.3."""


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colours as WCAG 2 defines it."""
    low, high = sorted(luminance(*to_rgb(colour)) for colour in (one, other))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("name", LINES)
def test_a_line_stands_out_on_a_light_and_on_a_dark_page(name: str) -> None:
    colour, paper = PALETTE[name], PALETTE["paper"]
    assert contrast(colour.light, paper.light) >= GRAPHICS_MIN
    assert contrast(colour.dark, paper.dark) >= GRAPHICS_MIN


def test_each_light_colour_has_one_meaning() -> None:
    assert len({colour.light for colour in PALETTE.values()}) == len(PALETTE)


@pytest.mark.parametrize("number", [0, 1, 2, 6, 8])
def test_curves_go_from_dark_to_light(number: int) -> None:
    colours = steps(number)
    assert len(set(colours)) == len(colours) == number
    lightness = [luminance(*to_rgb(colour)) for colour in colours]
    assert all(one < other for one, other in pairwise(lightness))


def test_more_curves_than_colours_share_some() -> None:
    assert len(steps(30)) == 30


def test_numbers_of_the_mesh_can_be_read_and_its_line_does_not_go_with_the_page() -> None:
    values = np.geomspace(*RANGE_PERCENT, 40)
    picture = rms_error([("", {(1.0, float(n)): v for n, v in enumerate(values)})])
    axes = picture.axes[0]
    cells = axes.collections[0].to_rgba(values)
    assert len(axes.texts) == len(cells)
    for cell, text in zip(cells, axes.texts, strict=True):
        assert contrast(to_hex(cell), str(text.get_color())) >= TEXT_MIN
    assert f"stroke: {ON_FILL}" in inline(picture, "p", "")
