"""Draw torque over angle, compensation off and then on: docs/images/ripple.svg, a moving picture.

`python tools/ripple_picture.py FOLDER` takes one turn from each of the two recordings that
`motord demo --out FOLDER` verified with. The picture moves by CSS alone and stands still, showing
both turns, where it is printed and for readers who prefer reduced motion.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from string import Template

import numpy as np

from motord.identification.point_ripple import rms_error_percent
from motord.recording.captures import true_torque_of
from motord.recording.reader import bounds_of, open_run
from motord.report.style import PALETTE
from motord.reproduce.evaluate import COLUMNS, BetweenTicks
from motord.rig.truth import load as load_truth

FILE = Path(__file__).resolve().parent.parent / "docs/images/ripple.svg"
TEMPLATE = Path(__file__).with_name("ripple_picture.svg")
RECORDINGS = {"off": "verify-off.mcap", "on": "verify-on.mcap"}
TORQUE_NM, SPEED_HZ = 3.0, 0.7
"""The operating point: the middle of the mesh."""
RATED_NM = 6.0
SAMPLES = 720
"""Of a turn: fifteen in each period of the cogging torque, which has 48 in a turn."""
LEFT, WIDTH = 64.0, 760.0


@dataclass(frozen=True)
class Panel:
    """A diagram: its top and height in the picture, the range of its values."""

    top: float
    height: float
    low: float
    high: float

    def y(self, value: float) -> float:
        """Return where a value lies in the picture."""
        return self.top + self.height * (self.high - value) / (self.high - self.low)

    def path(self, values: np.ndarray) -> str:
        """Return the `d` of a path through values (n,) at equal angles from 0 to 360 degrees."""
        x = np.linspace(LEFT, LEFT + WIDTH, values.size)
        points = (f"{a:.4g} {self.y(b):.4g}" for a, b in zip(x, values, strict=True))
        return "M" + "L".join(points)

    def scale(self, ticks: tuple[float, ...]) -> str:
        """Return grid lines with their values."""
        return "\n".join(
            f'<path class="grid" d="M{LEFT:g} {self.y(t):.4g}h{WIDTH:g}"/>'
            f'<text class="value" x="{LEFT - 8:g}" y="{self.y(t) + 4:.4g}">{t:g}</text>'
            for t in ticks
        ).replace(">-", ">\N{MINUS SIGN}")


TORQUE = Panel(top=84, height=206, low=1.6, high=4.4)
CURRENT = Panel(top=326, height=92, low=-14, high=14)


@dataclass(frozen=True)
class Turn:
    """One turn: true torque (SAMPLES,), commanded current of phase a (SAMPLES,), RMS error (%)."""

    torque_Nm: np.ndarray
    current_A: np.ndarray
    error_percent: float


def turn_of(path: Path) -> Turn:
    """Return the first turn at the operating point of a recording."""
    run = open_run(path)
    [point] = [
        p
        for p in run.operating_points()
        if (p["torque_Nm"], p["speed_Hz"]) == (TORQUE_NM, SPEED_HZ)
    ]
    truth = run.truth(COLUMNS, **bounds_of(point))
    ticks = run.ticks(("angle_rad", "i_cmd_a_A"), **bounds_of(point))
    true = true_torque_of(point, BetweenTicks(load_truth()).truth(truth))
    return Turn(
        over_angle(true.angle_rad, true.torque_Nm),
        over_angle(np.unwrap(ticks["angle_rad"].astype(float)), ticks["i_cmd_a_A"]),
        rms_error_percent(true.torque_Nm, RATED_NM, true.weights),
    )


def over_angle(angle_rad: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values (n,) at rising angles (n,) as (SAMPLES,) over the first whole turn."""
    start_rad = 2 * np.pi * np.ceil(angle_rad[0] / (2 * np.pi))
    return np.asarray(np.interp(start_rad + np.linspace(0, 2 * np.pi, SAMPLES), angle_rad, values))


def picture(turns: dict[str, Turn]) -> str:
    """Return the picture of a turn without and one with compensation."""
    parts = {
        "torque_scale": TORQUE.scale((2, 3, 4)),
        "current_scale": CURRENT.scale((-10, 0, 10)),
    }
    for name, turn in turns.items():
        parts |= {
            f"torque_{name}": TORQUE.path(turn.torque_Nm),
            f"current_{name}": CURRENT.path(turn.current_A),
            f"error_{name}": f"{turn.error_percent:.2g}",
        }
    colours = {
        f"{name}_{mode}": getattr(colour, mode)
        for name, colour in PALETTE.items()
        for mode in ("light", "dark")
    }
    return Template(TEMPLATE.read_text()).substitute(parts, **colours)


def main(folder: Path) -> None:
    """Draw the picture from the recordings of a demo."""
    turns = {name: turn_of(folder / file) for name, file in RECORDINGS.items()}
    FILE.write_text(picture(turns), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
