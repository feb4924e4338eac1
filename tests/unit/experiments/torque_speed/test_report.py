"""Pictures of the efficiency map: what stands in them can be read on a light and a dark page."""

from types import SimpleNamespace
from typing import Any, cast

from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from motord.experiments.torque_speed.report import _points, losses
from motord.report.style import INK, PAPER


def test_figures_of_the_points_follow_the_page_with_a_halo_over_the_contours() -> None:
    """They were black in a dark page."""
    axes = Figure().subplots()
    point = SimpleNamespace(
        efficiency=SimpleNamespace(value=60.1), speed_mean_Hz=2.0, torque_mean_Nm=1.0
    )
    _points(axes, cast("Any", [point]))
    [figure] = axes.texts
    [halo] = figure.get_path_effects()
    assert (figure.get_text(), to_hex(figure.get_color())) == ("60.1", INK)
    assert isinstance(halo, withStroke)
    assert vars(halo)["_gc"]["foreground"] == PAPER


def test_one_turn_a_second_is_not_spoken_of_as_several() -> None:
    loss = SimpleNamespace(value=2.0, high=2.1)
    points = [
        SimpleNamespace(loss=loss, mode="motoring", speed_Hz=speed_Hz, torque_mean_Nm=1.0)
        for speed_Hz in (1.0, 2.0)
    ]
    [axes] = losses(cast("Any", points)).axes
    assert axes.get_legend_handles_labels()[1] == ["1 turn/s, motoring", "2 turns/s, motoring"]


def test_losses_below_zero_are_in_the_picture() -> None:
    """What they are questioned for has to be seen."""
    points = [
        SimpleNamespace(
            loss=SimpleNamespace(value=loss_W, high=loss_W + 0.5), mode="motoring", speed_Hz=2.0,
            torque_mean_Nm=1.0,
        )
        for loss_W in (-4.0, -2.0)
    ]  # fmt: skip
    [axes] = losses(cast("Any", points)).axes
    low_W, high_W = axes.get_ylim()
    assert low_W <= -4.5 < high_W
