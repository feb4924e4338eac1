"""RMS error over the torque/speed mesh, as heat maps with their values."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure

from motord.calibration import TorqueSpeed
from motord.report.style import ON_FILL, PAPER, figure, luminance

_MAP = LinearSegmentedColormap.from_list(
    "ripple", ["#0d4f7c", "#3f8fbe", "#a9cfe3", "#f3e6c8", "#ec9a62", "#b23a1e", "#6d1410"]
)
"""Blue is smooth, red is rough; the turn from one to the other lies at 1 %."""

WHITE_BELOW = 0.179
"""The luminance at which white and black text have the same contrast, 4.6 : 1."""

RANGE_PERCENT = (0.03, 30.0)


def rms_error(panels: Sequence[tuple[str, Mapping[TorqueSpeed, float]]]) -> Figure:
    """Return heat maps of RMS errors in percent of rated torque, one a panel, all of one scale."""
    torques_Nm = sorted({point[0] for _, values in panels for point in values})
    with figure(1.6 + 0.36 * max(len(torques_Nm), 3)) as picture:
        all_axes = picture.subplots(1, len(panels), squeeze=False, sharey=True)[0]
        norm = LogNorm(*RANGE_PERCENT, clip=True)
        for axes, (title, values) in zip(all_axes, panels, strict=True):
            image = _heat_map(axes, torques_Nm, values, norm)
            axes.set_title(title)
        all_axes[0].set_ylabel("torque set-point (Nm)")
        bar = picture.colorbar(image, ax=list(all_axes), pad=0.02, aspect=18)
        bar.set_ticks([0.1, 1.0, 10.0], labels=["0.1", "1", "10"])
        bar.set_label("RMS error (% of rated)")
        bar.outline.set_visible(False)
        bar.ax.axhline(1.0, color=ON_FILL, linewidth=1.0)
        return picture


def _heat_map(
    axes: Axes, torques_Nm: Sequence[float], values: Mapping[TorqueSpeed, float], norm: LogNorm
) -> QuadMesh:
    """Draw values; torques_Nm: those of all panels, which share the rows."""
    speeds_Hz = sorted({speed_Hz for _, speed_Hz in values})
    grid = np.full((len(torques_Nm), len(speeds_Hz)), np.nan)
    for (torque_Nm, speed_Hz), value in values.items():
        grid[torques_Nm.index(torque_Nm), speeds_Hz.index(speed_Hz)] = value
    image = axes.pcolormesh(grid, norm=norm, cmap=_MAP, edgecolors=PAPER, linewidth=2.0)
    for row, column in np.argwhere(np.isfinite(grid)):
        value = grid[row, column]
        red, green, blue, _ = _MAP(float(norm(value)))
        axes.text(
            column + 0.5, row + 0.5, in_percent(value), ha="center", va="center", fontsize=9.5,
            color="white" if luminance(red, green, blue) < WHITE_BELOW else "black",
        )  # fmt: skip
    axes.set_xticks(np.arange(len(speeds_Hz)) + 0.5, [f"{speed:g}" for speed in speeds_Hz])
    axes.set_yticks(np.arange(len(torques_Nm)) + 0.5, [f"{torque:g}" for torque in torques_Nm])
    axes.set_xlabel("speed (turns/s)")
    axes.grid(visible=False)
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)
    return image


def in_percent(value: float) -> str:
    """Return a value in percent with three digits or fewer: 12, 5.7, 0.41, 0.06, <0.01."""
    if 0 < value < 0.005:
        return "<0.01"
    if value >= 9.95:
        return f"{value:.0f}"
    return f"{value:.1f}" if value >= 0.995 else f"{value:.2f}"
