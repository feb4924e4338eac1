"""What packages announce of figures: what was announced otherwise is refused, not misread."""

import pytest

from motord.config.figures import FigureKind


def test_all_but_the_name_are_named():
    """Earlier versions had the unit where the summary came to stand."""
    with pytest.raises(TypeError):
        FigureKind("gain_Nm", "Nm", "gain of the sensor", "gain_Nm")


@pytest.mark.parametrize("field", ["value", "rows"])
def test_a_path_to_a_figure_is_refused(field):
    """Earlier versions followed it; no figure would be found."""
    with pytest.raises(ValueError, match=f"figure gain_Nm: {field} = 'fit.gain_Nm' is a path"):
        FigureKind("gain_Nm", summary="gain of the sensor", **{field: "fit.gain_Nm"})


def test_value_and_unit_are_those_of_the_name_unless_stated():
    one = FigureKind("gain_Nm", summary="gain of the sensor")
    assert (one.value, one.unit) == ("gain_Nm", "Nm")
