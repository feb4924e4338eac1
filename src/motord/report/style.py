"""How the pictures look: colours by meaning, light and dark, and matplotlib's settings.

Pictures are drawn in the light colours; `html.inline` turns each into a CSS variable, so that a
page shows them light, dark or on paper. Every light colour is used for one meaning only.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure


@dataclass(frozen=True)
class Colour:
    """A colour on a light and on a dark page."""

    light: str
    dark: str


_STEPS = (
    ("#46085c", "#287d8e"), ("#482576", "#21918c"), ("#423f85", "#20a486"), ("#39568c", "#37b878"),
    ("#2f6c8e", "#5ec962"), ("#26818e", "#90d743"), ("#1f948c", "#c8e020"), ("#22a683", "#fde725"),
)  # fmt: skip
"""Of viridis, on either page those that stand out against it; the last of the light is darker."""

PALETTE = {
    "ink": Colour("#20242b", "#e7e9ec"),
    "soft": Colour("#626b78", "#a3abb7"),
    "grid": Colour("#dde1e7", "#343a43"),
    "before": Colour("#c2502f", "#f08a66"),
    "after": Colour("#1670a8", "#5cb6ea"),
    "reference": Colour("#3c8a4b", "#77c987"),
    "other": Colour("#9a6b12", "#dcae52"),
    "paper": Colour("#fefefe", "#15181d"),
    "warning": Colour("#d9a62e", "#e5bd5b"),
    "serious": Colour("#b3261e", "#f2857b"),
    **{f"step{number}": Colour(*both) for number, both in enumerate(_STEPS)},
}
"""before and after compensation; reference is the truth or the last calibration; of findings;
steps of what has an order, such as speeds, from low to high."""

INK = PALETTE["ink"].light
SOFT = PALETTE["soft"].light
GRID = PALETTE["grid"].light
BEFORE = PALETTE["before"].light
AFTER = PALETTE["after"].light
REFERENCE = PALETTE["reference"].light
OTHER = PALETTE["other"].light
PAPER = PALETTE["paper"].light
SERIOUS = PALETTE["serious"].light

ON_FILL = "#111111"
"""Lines on areas that are filled with the same colours on every page."""

WIDTH_IN = 9.0
"""Width of a picture that fills the page."""

SETTINGS: dict[Any, Any] = {
    "font.family": ["DejaVu Sans"],
    "font.size": 10.0,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 8.0,
    "axes.labelsize": 10.0,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.edgecolor": SOFT,
    "axes.linewidth": 0.8,
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "figure.autolayout": False,  # a layout of the user's own would move what is laid out
    "figure.constrained_layout.use": False,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "text.color": INK,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "svg.fonttype": "path",
    "svg.hashsalt": "motord",
    "path.simplify": True,
}


def steps(number: int) -> list[str]:
    """Return the colours of `number` curves from low to high; many curves share some."""
    last = len(_STEPS) - 1
    return [_STEPS[round(last * at / max(number - 1, 1))][0] for at in range(number)]


def luminance(red: float, green: float, blue: float) -> float:
    """Return the relative luminance of a colour of parts 0 to 1, as WCAG 2 defines it."""
    linear = [
        part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4
        for part in (red, green, blue)
    ]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


drawing = partial(mpl.rc_context, SETTINGS)
"""Context in which pictures are drawn; afterwards the settings are those that were before."""


@contextmanager
def figure(height_in: float) -> Iterator[Figure]:
    """Yield an empty figure as wide as the page, to be drawn in the block."""
    with drawing():
        yield Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
