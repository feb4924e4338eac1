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
}
"""before and after compensation; reference is the truth or the last calibration; of findings."""

INK = PALETTE["ink"].light
SOFT = PALETTE["soft"].light
GRID = PALETTE["grid"].light
BEFORE = PALETTE["before"].light
AFTER = PALETTE["after"].light
REFERENCE = PALETTE["reference"].light
OTHER = PALETTE["other"].light
PAPER = PALETTE["paper"].light
SERIOUS = PALETTE["serious"].light

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


drawing = partial(mpl.rc_context, SETTINGS)
"""Context in which pictures are drawn; afterwards the settings are those that were before."""


@contextmanager
def figure(height_in: float) -> Iterator[Figure]:
    """Yield an empty figure as wide as the page, to be drawn in the block."""
    with drawing():
        yield Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
