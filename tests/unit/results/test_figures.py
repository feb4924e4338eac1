"""Figures of a result with unit and interval, from its JSON, whichever experiment it is of."""

from pkgutil import resolve_name

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.config.experiments import analysis_kinds
from motord.experiments.analysis import encode
from motord.experiments.back_emf.result import ElectricalHarmonic
from motord.experiments.check_calibration.result import Change
from motord.experiments.cogging.result import DirectionDifference, MeanHarmonic
from motord.experiments.friction.result import DirectionalFriction, Stribeck, Windage
from motord.experiments.inertia.acceleration import Acceleration
from motord.experiments.inertia.error_budget import Share
from motord.experiments.sensitivity.slope_fit import Branch
from motord.identification.point_ripple import PointRipple
from motord.intervals import IntervalEstimate, coverage_factor
from motord.results.figures import ResultFigure, figures
from tests.support.calibrations import calibration

T5 = coverage_factor(5)
MANY = coverage_factor()


def by_field(content):
    found = figures(content)
    assert len({one.field for one in found}) == len(found)
    return {one.field: one for one in found}


def interval(value, stderr, factor=MANY):
    return {"low": value - factor * stderr, "high": value + factor * stderr}


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ({"peak_Nm": 0.4}, [ResultFigure("peak_Nm", "Nm", 0.4)]),
        (
            {"delay_s": 2.0, "delay_stderr_s": 1.0, "degrees_of_freedom": 5},
            [ResultFigure("delay_s", "s", 2.0, 1.0, 2 - T5, 2 + T5)],
        ),
        (
            {"inertia_kg_m2": 3.0, "uncertainty_kg_m2": 0.5, "interval_95_kg_m2": [1.5, 4.0]},
            [ResultFigure("inertia_kg_m2", "kg m2", 3.0, 0.5, 1.5, 4.0)],
        ),
        (
            {"coulomb_Nm": 3.0, "coulomb_low_Nm": 2.0, "coulomb_high_Nm": 5.0},
            [ResultFigure("coulomb_Nm", "Nm", 3.0, None, 2.0, 5.0)],
        ),
        (
            {"resistance_K_per_W": 3.0, "resistance_low_K_per_W": 2.0,
             "resistance_high_K_per_W": 5.0},
            [ResultFigure("resistance_K_per_W", "K/W", 3.0, None, 2.0, 5.0)],
        ),
        (
            {"order": 4, "amplitude_Nm": 1.0, "phase_rad": 2.0, "stderr_Nm": 0.25,
             "half_width_Nm": 0.5, "phase_half_width_rad": 1.0},
            [
                ResultFigure("order", "", 4.0),
                ResultFigure("amplitude_Nm", "Nm", 1.0, 0.25, 0.5, 1.5),
                ResultFigure("phase_rad", "rad", 2.0, None, 1.0, 3.0),
            ],
        ),
        (
            {"rise_K_per_A2": 1.0, "rise_stderr_K_per_A2": 0.1, "rise_low_K_per_A2": 0.8,
             "rise_high_K_per_A2": 1.2},
            [ResultFigure("rise_K_per_A2", "K/A2", 1.0, 0.1, 0.8, 1.2)],
        ),
        (
            {"error_percent": {"after": {"max": 2}}},
            [ResultFigure("error_percent.after.max", "%", 2)],
        ),
        ({"alpha": [1, 2, 3]}, [ResultFigure(f"alpha.{'abc'[n]}", "", n + 1) for n in range(3)]),
        ({"turns": [1, 2, 3]}, [ResultFigure(f"turns.{n}", "", n) for n in (1, 2, 3)]),
        ({"tau_cog_Nm": [0.1] * 17, "pairs": [[1, 2]], "seen": True, "text": "1"}, []),
        ({"a": float("nan"), "b": float("inf"), "c": 10**400, "d": None}, []),
        ({"motor": {"slots": 48}, "told": {"x_rad": 1.0}, "freedom": 4}, []),
        ({"x_Nm": 2.0, "interval_95_Nm": [1.0]}, [ResultFigure("x_Nm", "Nm", 2.0)]),
        ({"value": 1.0, "stderr": "big", "unit": None}, [ResultFigure("value", "", 1.0)]),
        (
            {"degrees_of_freedom": {"alpha": [5]}, "alpha": [0.0, None, 1.0], "alpha_stderr": [1]},
            [ResultFigure("alpha.a", "", 0.0, 1.0, -T5, T5), ResultFigure("alpha.c", "", 1.0)],
        ),
        (
            {"degrees_of_freedom": 5, "gain": [0.0], "gain_stderr": [1]},
            [ResultFigure("gain.1", "", 0.0, 1.0, -T5, T5)],
        ),
        (
            {"degrees_of_freedom": {"x_Nm": 5}, "list": [{"order": 4, "x_Nm": 0.0, "stderr_Nm": 1}],
             "part": {"x_Nm": 0.0, "stderr_Nm": 1, "y_s": 0.0, "stderr_s": 1}},
            [
                ResultFigure("list.4.x_Nm", "Nm", 0.0, 1.0, -T5, T5),
                ResultFigure("part.x_Nm", "Nm", 0.0, 1.0, -T5, T5),
                ResultFigure("part.y_s", "s", 0.0, 1.0, -MANY, MANY),
            ],
        ),
        ({"stderr_Nm": 1.0, "x_Nm": 0.0, "y_s": 2.0, "degrees_of_freedom": 5},
         [ResultFigure("x_Nm", "Nm", 0.0, 1.0, -T5, T5), ResultFigure("y_s", "s", 2.0)]),
        ({"uncertainty": 3.0, "stderr": 1.0, "value": 0.0, "degrees_of_freedom": 5},
         [ResultFigure("value", "", 0.0, 3.0, -3 * T5, 3 * T5)]),
        ({"x_Nm": 0.0, "y_Nm": 0.0, "y_stderr_Nm": 1.0, "low_Nm": 1.0, "high_Nm": 2.0},
         [ResultFigure("x_Nm", "Nm", 0.0), ResultFigure("y_Nm", "Nm", 0.0, 1.0, 1.0, 2.0)]),
    ],
)  # fmt: skip
def test_names_say_what_is_what(content, expected):
    assert figures(content) == expected


@pytest.mark.parametrize(
    ("elements", "fields"),
    [
        ([{"order": 16, "a_Nm": 1}, {"order": 8, "a_Nm": 1}], ["16.a_Nm", "8.a_Nm"]),
        ([{"order": 8, "a_Nm": 1}, {"order": 8, "a_Nm": 2}], ["8.a_Nm", "8#2.a_Nm"]),
        ([{"a_Nm": 1}, {"a_Nm": 1}], ["1.a_Nm", "2.a_Nm"]),
        ([{"torque_Nm": 3.0, "speed_Hz": -0.6, "after": 1}], ["3Nm,-0.6Hz.after"]),
        (
            [{"torque_Nm": 3, "speed_Hz": 1, "compensate": 0, "x": 1}],
            ["3Nm,1Hz,compensate=0.x"],
        ),
        ([{"speed_set_Hz": 1.0, "direction": -1, "x": 1}], ["1Hz,direction=-1.x"]),
        ([{"direction": "forwards", "x": 1}, {"direction": None, "x": 2}], ["1.x", "2.x"]),
        ([{"name": "gain-a", "value": 1, "unit": "%"}], ["gain-a"]),
    ],
)
def test_an_element_is_known_by_what_it_is_of_not_by_its_place(elements, fields):
    content = {"list": elements}
    found = [one for one in figures(content) if not one.field.endswith("direction")]
    assert [one.field for one in found] == [f"list.{field}" for field in fields]


def test_calibration():
    freedom = {"alpha": (5.0, 6.0, 7.0), "beta_A": (5.0, 5.0, 5.0)}
    harmonic = {"order": 48, "amplitude_Nm": 0.3, "phase_rad": 1.0, "stderr_Nm": 0.01,
                "phase_stderr_rad": 0.02, "degrees_of_freedom": 5.0}  # fmt: skip
    made = calibration(degrees_of_freedom=freedom, tau_cog_harmonics=[harmonic])
    found = by_field(made.to_json())
    assert found["alpha.a"] == ResultFigure("alpha.a", "", 0.8, 0.001, **interval(0.8, 0.001, T5))
    assert found["alpha.b"].high == pytest.approx(1.118 + coverage_factor(6) * 0.001)
    assert found["beta_A.c"] == ResultFigure(
        "beta_A.c", "A", -0.5, 0.01, **interval(-0.5, 0.01, T5)
    )
    assert found["tau_cog_harmonics.48.amplitude_Nm"].stderr == 0.01
    assert found["tau_cog_harmonics.48.phase_rad"].low == pytest.approx(1.0 - T5 * 0.02)
    assert found["condition_number"].stderr is None
    halves = [(found[f"alpha.{p}"].high - found[f"alpha.{p}"].low) / 2 for p in "abc"]
    assert halves == pytest.approx(made.alpha_half_width)


def test_results_of_other_experiments():
    """A key that is renamed there loses its interval here."""
    content = {
        "cogging": MeanHarmonic(16, 0.08, 0.6, 0.001, 0.01, 0.003, 0.03, True),
        "back_emf": ElectricalHarmonic(1, 0.2, 0.0, 1e-3, 5.0, 2e-3, 2.0, True),
        "change": Change("gain-a", "the gain", "%", 0.1, 0.2, 5, 0.7, 0.9, 0.1, False),
        "directions": [DirectionDifference(16, 0.3, 0.2, 0.0, 0.1, 0.01, 0.05)],
        "friction": DirectionalFriction(
            "forwards", 3, 1.0, 5.0, IntervalEstimate(0.05, 0.006, 0.04, 0.07), 0.01,
            IntervalEstimate(0.002, 0.0007, 0.001, 0.004), 0.0005,
            Stribeck(
                IntervalEstimate(0.03, 0.008, 0.02, 0.05), IntervalEstimate(1.5, 0.2, 1.2, 1.9)
            ),
            None, (),
            Windage(0.0, 1e-3, 2e-3, 0.0, 1e-3, 0.0, False), 0.01, (), (),
        ),
        "inertia": Acceleration(0.01, 1e-4, 5.0, 0.0, 0.0, (), ()),
        "share": Share("bar", 1, 0.01, -0.8, 0.005),
        "slope": Branch(1.5, 0.1, 0.2, 1.4, np.ones(4, bool)),
        "point": PointRipple(3.0, 1.0, 1, 5, 0.2, 0.05, 0.3, *(None,) * 4),
    }  # fmt: skip
    found = {
        name: (one.stderr, one.low, one.high) for name, one in by_field(encode(content)).items()
    }
    assert found["cogging.amplitude_Nm"] == pytest.approx((0.001, 0.077, 0.083))
    assert found["cogging.phase_rad"] == pytest.approx((0.01, 0.57, 0.63))
    assert found["back_emf.amplitude_V_s_per_rad"][0] == 1e-3
    assert found["back_emf.amplitude_V_s_per_rad"][2] == pytest.approx(0.2 + T5 * 1e-3)
    assert found["back_emf.phase_rad"] == pytest.approx(
        (2e-3, -4.303 * 2e-3, 4.303 * 2e-3), rel=1e-3
    )
    assert found["change"] == pytest.approx((0.2, 0.1 - 0.2 * T5, 0.1 + 0.2 * T5))
    assert found["directions.16.difference_Nm"][0] == 0.01
    assert found["directions.16.forward_Nm"] == (None, None, None)
    assert found["friction.coulomb_Nm"] == (0.006, 0.04, 0.07)
    assert found["friction.viscous_Nm_s_per_rad"] == (0.0007, 0.001, 0.004)
    assert found["friction.stribeck.torque_Nm"] == (0.008, 0.02, 0.05)
    assert found["friction.stribeck.speed_rad_s"] == (0.2, 1.2, 1.9)
    assert found["inertia.inertia_kg_m2"] == pytest.approx((1e-4, 0.01 - T5 / 1e4, 0.01 + T5 / 1e4))
    assert found["inertia.commanded_kg_m2"] == (None, None, None)
    assert {"share.half_width", "share.sensitivity", "share.uncertainty"} <= set(found)
    slope = found["slope.slope_percent"]
    assert slope == pytest.approx((0.1, 1.5 - 0.430265, 1.5 + 0.430265), rel=1e-5)  # t of 4 - 2
    assert found["point.rms_percent"][0] == 0.05
    assert found["point.raw_percent"] == (None, None, None)


def test_the_leading_quantity_of_an_analysis_has_the_errors_without_a_name():
    leading = analysis_kinds()["verify"].leading
    point = encode(PointRipple(3.0, 1.0, 1, 5, 0.2, 0.05, 0.3, *(None,) * 4))
    for order in (sorted(point), sorted(point, reverse=True)):
        content = {"points": [{key: point[key] for key in order}]}
        errors = {one.field.split(".")[-1]: one.stderr for one in figures(content, leading)}
        assert (errors["rms_percent"], errors["raw_percent"]) == (0.05, None)


def test_a_quantity_may_have_degrees_of_freedom_of_its_own():
    content = {"delay_s": 1e-3, "delay_stderr_s": 1e-5, "delay_degrees_of_freedom": 2.0,
               "x_Nm": 1.0, "x_stderr_Nm": 0.1, "degrees_of_freedom": 5}  # fmt: skip
    found = by_field(content)
    assert set(found) == {"delay_s", "x_Nm"}
    assert found["delay_s"].high == pytest.approx(1e-3 + coverage_factor(2) * 1e-5)
    assert found["x_Nm"].high == pytest.approx(1.0 + T5 * 0.1)
    del content["delay_degrees_of_freedom"]  # of earlier versions
    assert by_field(content)["delay_s"].high == pytest.approx(1e-3 + T5 * 1e-5)


def test_every_analysis_has_its_page():
    for kind in analysis_kinds().values():
        analysis, (command, _) = resolve_name(kind.command), kind.command.split(":")
        assert analysis.estimate.__module__.rpartition(".")[0] == command.rpartition(".")[0]
        assert analysis.report or resolve_name(command.replace(".command", ".report:report"))


def test_every_analysis_names_the_schema_of_its_json():
    schemas = [kind.schema for kind in analysis_kinds().values()]
    assert all(schemas)
    assert len(set(schemas)) == len(schemas) == 14


KEYS = st.sampled_from(
    ["alpha", "alpha_stderr", "x_Nm", "x_stderr_Nm", "stderr_Nm", "half_width_Nm", "x_low_Nm",
     "x_high_Nm", "interval_95_Nm", "value", "stderr", "unit", "order", "name", "torque_Nm",
     "speed_Hz", "degrees_of_freedom", "x_degrees_of_freedom", "list", "part"]
)  # fmt: skip
LEAVES = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3)
CONTENTS = st.recursive(
    LEAVES,
    lambda part: st.lists(part, max_size=4) | st.dictionaries(KEYS, part, max_size=6),
    max_leaves=25,
)


@given(st.dictionaries(KEYS, CONTENTS, max_size=8))
def test_whatever_the_json_is_figures_are_finite_numbers(content):
    for one in figures(content):
        numbers = [one.value, one.stderr, one.low, one.high]
        assert all(type(number) is float for number in numbers if number is not None)
        assert one.value == one.value
        assert one.field
