"""Panels of the mesh share their rows: a torque stands at its own number in each."""

import pytest

from motord.report.plots.mesh import in_percent, rms_error


def test_panels_of_other_torques_have_their_values_at_their_torques() -> None:
    few = {(2.0, 0.6): 6.1, (4.0, 0.6): 7.5}
    many = {(float(torque_Nm), 0.5): 0.1 * torque_Nm for torque_Nm in range(1, 6)}
    picture = rms_error([("few", few), ("many", many)])
    names = [label.get_text() for label in picture.axes[0].get_yticklabels()]
    assert names == ["1", "2", "3", "4", "5"]
    for axes, values in zip(picture.axes, (few, many), strict=False):
        rows = {text.get_text(): names[int(text.get_position()[1])] for text in axes.texts}
        assert rows == {
            f"{value:.2f}" if value < 0.995 else f"{value:.1f}": f"{torque_Nm:g}"
            for (torque_Nm, _), value in values.items()
        }


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0.00"), (1e-6, "<0.01"), (0.0049, "<0.01"), (0.0051, "0.01"), (0.994, "0.99"),
        (0.996, "1.0"), (9.94, "9.9"), (9.96, "10"),
    ],
)  # fmt: skip
def test_an_error_is_never_so_small_that_it_is_none(value: float, text: str) -> None:
    assert in_percent(value) == text
