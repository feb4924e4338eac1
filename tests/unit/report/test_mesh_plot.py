"""Panels of the mesh share their rows: a torque stands at its own number in each."""

from motord.report.plots.mesh import rms_error


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
