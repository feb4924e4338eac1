"""Figures of results: uncertainty combined from Type A and B, selection, doubts."""

import json
from dataclasses import fields, make_dataclass, replace
from math import hypot
from typing import get_type_hints

import pytest

from motord.calibration import Calibration, Harmonic
from motord.config.experiments import analysis_kinds
from motord.config.figures import FigureKind
from motord.experiments.analysis import encode
from motord.experiments.back_emf.result import ElectricalHarmonic, MeasuredBackEmf
from motord.experiments.cogging.result import MeanHarmonic, MeasuredCogging
from motord.experiments.friction.result import DirectionalFriction, Friction
from motord.experiments.inertia.acceleration import Acceleration
from motord.experiments.inertia.oscillation import Oscillation
from motord.experiments.profile.result import ProfileTracking
from motord.experiments.ripple.estimate import MeshRipple
from motord.experiments.soak.result import FigureTrend, SoakResult
from motord.experiments.thermal.result import ThermalConstants, TimeConstant
from motord.experiments.torque_speed.result import EfficiencyMap, OperatingPower
from motord.identification.point_ripple import PointRipple
from motord.intervals import IntervalEstimate, coverage_factor, t_quantile
from motord.results.figures import error_keys
from motord.uncertainty_budget import Contribution
from motord.verdict.decision import Tolerance, decide
from motord.verdict.figures import figures_of
from tests.unit.verdict.made_up import calibration, contribution


def of(analysis, name, result, **at):
    kinds = {kind.name: kind for kind in analysis_kinds()[analysis].figures}
    return figures_of(kinds[name], result, at)


def type_of(kind, name):
    """Return the type of a field or of a property."""
    own = vars(kind).get(name)
    function = getattr(own, "fget", None) or getattr(own, "func", None)
    return get_type_hints(function)["return"] if function else get_type_hints(kind).get(name)


def field_of_type(name, type_):
    """Return an object that has one field of a type."""
    value = IntervalEstimate() if type_ is IntervalEstimate else None
    return make_dataclass("Field", [name])(value)


def keys(kind):
    """Return the keys that a class has in JSON, in order."""
    if hasattr(kind, "model_fields"):
        return list(kind.model_fields)
    names = getattr(kind, "JSON", None) or [one.name for one in fields(kind)]
    pairs = [(name, path or name) for name, _, path in (one.partition("=") for one in names)]
    return [key for name, path in pairs for key in encode(field_of_type(name, type_of(kind, path)))]


CLASSES = {
    "calibrate": ((Calibration,), Harmonic), "cogging": ((MeasuredCogging,), MeanHarmonic),
    "back-emf": ((MeasuredBackEmf,), ElectricalHarmonic),
    "friction": ((Friction,), DirectionalFriction),
    "inertia": ((Oscillation, Acceleration), None), "verify": ((MeshRipple,), PointRipple),
    "torque-speed": ((EfficiencyMap,), OperatingPower), "profile": ((ProfileTracking,), None),
    "soak": ((SoakResult,), FigureTrend),
    "thermal": ((ThermalConstants,), TimeConstant),
}  # fmt: skip
"""Of each analysis the classes of its result, of which one is, and of its rows."""


def errors_of(figure, keys):
    """Return the keys of a figure's errors by role, of an object with keys in this order."""
    leading = (figure.value,) if figure.leading else ()
    return error_keys(dict.fromkeys(keys), leading).get(figure.value, {})


def test_all_that_is_announced_is_in_the_results():
    announced = {kind.name: kind.figures for kind in analysis_kinds().values() if kind.figures}
    assert announced.keys() == CLASSES.keys()
    for name, figures in announced.items():
        results, row = CLASSES[name]
        for figure in figures:
            places = [keys(row)] if figure.rows else [keys(result) for result in results]
            for place in places:
                assert figure.value in place, (name, figure.value)
                stated = errors_of(figure, place)
                assert (
                    stated.keys() & {"stderr", "uncertainty"} or figure.budget
                )  # a bare interval has no known freedom
                assert ("low" in stated) == ("high" in stated)
                assert errors_of(figure, sorted(place)) == stated
                assert errors_of(figure, reversed(place)) == stated
            for result in results:
                assert not figure.rows or figure.rows in keys(result)
            assert figure.by in ((), ("phase",)) or set(figure.by) <= set(keys(row))
            assert not figure.budget or figure.budget in Contribution.model_fields


def result_of(class_, **stated):
    """Return the JSON of a result in which what is stated has the keys of its class."""
    assert set(stated) <= set(keys(class_)), (class_, stated)
    return encode(stated)


def test_errors_and_degrees_of_freedom_of_results_are_found_whatever_the_order_of_keys():
    stator = MeanHarmonic(16, 0.08, 0.6, 0.001, 0.01, 0.001 * coverage_factor(9), 0.03, True)
    line = ElectricalHarmonic(1, 0.2, 0.0, 0.001, 5.0, 2e-3, 2.0, True)
    inertia = encode(Acceleration(0.01, 1e-4, 5.0, 0.03, 0.04, (), ()))
    del inertia["interval_95_kg_m2"]  # which shows the freedom, too
    results = {
        ("calibrate", "alpha"): (calibration(budget=[contribution("A")]), (0.003, 4.0)),
        ("calibrate", "beta_A"): (calibration(budget=[contribution("A")]), (0.01, 4.0)),
        ("cogging", "cogging_Nm"): (
            result_of(MeasuredCogging, harmonics=[stator], degrees_of_freedom=9),
            (0.001, 9.0),
        ),
        ("back-emf", "back_emf_V_s_per_rad"): (
            result_of(MeasuredBackEmf, harmonics=[line], degrees_of_freedom=9),
            (0.001, 5.0),
        ),
        ("inertia", "inertia_kg_m2"): (inertia, (1e-4, 5.0)),
    }
    for (analysis, name), (result, expected) in results.items():
        for one in (result, json.loads(json.dumps(result, sort_keys=True))):
            figure, *_ = of(analysis, name, one)
            found = (figure.standard_uncertainty, figure.degrees_of_freedom)
            assert found == pytest.approx(expected), (analysis, name)


def test_type_a_and_b_together_and_their_freedom():
    a, b, c = of("calibrate", "alpha", calibration())
    assert [one.value for one in (a, b, c)] == [0.8, 1.0, 1.25]
    assert a.name == "alpha, phase a"
    for one, freedom in ((a, 4.0), (b, 5.0), (c, 6.0)):
        assert one.standard_uncertainty == pytest.approx(0.005)
        assert one.degrees_of_freedom == pytest.approx(freedom * (5 / 3) ** 4)  # GUM, G.4


def test_a_figure_without_an_error_of_its_own_has_that_of_the_budget():
    [one] = of("calibrate", "delta_epsilon", calibration())
    assert (one.value, one.standard_uncertainty) == (1.01, pytest.approx(0.005))


def test_a_budget_that_is_missing_leaves_the_uncertainty_unknown():
    for name in ("alpha", "alpha_spread", "delta_epsilon"):
        for one in of("calibrate", name, calibration(budget=[])):
            assert one.standard_uncertainty is None
            assert one.doubt


def test_a_spread_has_the_sum_of_the_two_largest_errors_and_the_fewest_freedom():
    result = calibration(alpha_stderr=[0.03, 0.003, 0.04])
    [one] = of("calibrate", "alpha_spread", result)
    assert one.value == pytest.approx(0.45)
    assert one.standard_uncertainty == pytest.approx(hypot(0.03, 0.004) + hypot(0.04, 0.004))
    a, *_ = of("calibrate", "alpha", result)
    assert one.degrees_of_freedom == a.degrees_of_freedom


def test_orders_are_selected_and_one_that_is_not_there_is_a_doubt():
    [one] = of("calibrate", "cogging_Nm", calibration(), order=48)
    assert (one.name, one.value) == ("cogging_Nm, order 48", 0.3)
    assert one.standard_uncertainty == pytest.approx(0.005)
    assert one.degrees_of_freedom == pytest.approx(3 * (5 / 3) ** 4)
    [none] = of("calibrate", "cogging_Nm", calibration(), order=49)
    assert (none.value, none.doubt) == (None, "it is not in the result")
    both = of("calibrate", "cogging_Nm", calibration())
    assert [x.doubt for x in both] == ["", "its uncertainty is not stated"]


POINTS = [
    {"torque_Nm": t, "speed_Hz": 1.0, "compensate": c, "rms_percent": v, "stderr_percent": u}
    for t, c, v, u in ((2.0, 7, 0.2, 0.01), (4.0, 7, 0.4, 0.03), (2.0, 0, 8.0, None))
]


def test_a_mean_over_points_has_the_mean_error_whatever_their_correlation():
    [one] = of("verify", "rms_mean_percent", {"points": POINTS}, compensate=7)
    assert (one.value, one.standard_uncertainty) == (pytest.approx(0.3), pytest.approx(0.02))
    [all_] = of("verify", "rms_mean_percent", {"points": POINTS})
    assert all_.doubt == "an uncertainty is not stated"
    [two] = of("verify", "rms_percent", {"points": POINTS}, torque_Nm=2.0, compensate=7)
    assert two.value == 0.2


def test_an_interval_is_as_good_as_an_error():
    row = {
        "direction": "forwards",
        "coulomb_Nm": 0.05,
        "coulomb_low_Nm": 0.04,
        "coulomb_high_Nm": 0.06,
    }
    result = {"directions": [row, {**row, "direction": "backwards"}], "findings": []}
    [one] = of("friction", "coulomb_Nm", result, direction="backwards")
    assert one.standard_uncertainty == pytest.approx(0.01 / 1.959964, rel=1e-6)
    assert one.expanded_uncertainty == pytest.approx(0.01)


def coulomb(half_Nm, stderr_Nm=None):
    row = {"direction": "forwards", "coulomb_Nm": 0.0, "coulomb_stderr_Nm": stderr_Nm}
    row |= {"coulomb_low_Nm": -half_Nm, "coulomb_high_Nm": half_Nm}
    return of("friction", "coulomb_Nm", {"directions": [row], "findings": []})[0]


@pytest.mark.parametrize("freedom", [1, 2, 5, 9])
@pytest.mark.parametrize("risk", [0.1, 0.025, 0.01, 0.001])
def test_an_interval_with_its_error_keeps_any_risk(freedom, risk):
    one = coulomb(coverage_factor(freedom) * 0.01, 0.01)
    assert one.standard_uncertainty == pytest.approx(0.01)
    assert one.degrees_of_freedom == pytest.approx(freedom)
    limit = t_quantile(1 - risk, freedom) * 0.01
    assert decide(one, Tolerance(None, 1.001 * limit), risk).decision == "pass"
    assert decide(one, Tolerance(None, 0.999 * limit), risk).decision == "undecidable"


def test_an_interval_that_is_narrower_than_a_normal_one_has_many_degrees_of_freedom():
    one = coulomb(1.65 * 0.01, 0.01)
    assert (one.standard_uncertainty, one.degrees_of_freedom) == (0.01, None)


def test_of_an_interval_that_is_not_symmetric_the_longer_side_counts():
    row = {"resistance_K_per_W": 1.0, "resistance_stderr_K_per_W": 0.1}
    row |= {"resistance_low_K_per_W": 0.8, "resistance_high_K_per_W": 1 + 0.1 * coverage_factor(7)}
    [one] = of("thermal", "resistance_K_per_W", row)
    assert one.degrees_of_freedom == pytest.approx(7)


GAIN = FigureKind("gain_Nm", summary="of another package")
IN_ROWS = FigureKind("gain_Nm", summary="of another package", rows="rows")


@pytest.mark.parametrize(
    ("stated", "freedom"),
    [
        ({"gain_stderr_Nm": 0.1, "gain_degrees_of_freedom": 2}, 2.0),
        ({"gain_stderr_Nm": 0.1, "gain_degrees_of_freedom": 2, "degrees_of_freedom": 99}, 2.0),
        ({"gain_stderr_Nm": 0.1, "gain_degrees_of_freedom": None, "degrees_of_freedom": 3}, 3.0),
        ({"gain_stderr_Nm": 0.1, "gain_half_width_Nm": 0.1 * coverage_factor(2)}, 2.0),
        ({"stderr_Nm": 0.1, "half_width_Nm": 0.1 * coverage_factor(2), "freedom": 50}, 2.0),
        ({"gain_half_width_Nm": 0.1 * coverage_factor(2), "degrees_of_freedom": 2}, 2.0),
        ({"gain_stderr_Nm": 0.1, "gain_interval_95_Nm": [0.9, 1 + 0.1 * coverage_factor(2)]}, 2.0),
        ({"gain_stderr_Nm": 0.1, "degrees_of_freedom": 4}, 4.0),
    ],
)
def test_all_that_the_results_store_finds_of_a_figure_a_motor_test_finds(stated, freedom):
    row = {"gain_Nm": 1.0, **stated}
    for kind, result in ((GAIN, row), (IN_ROWS, {"rows": [row], "degrees_of_freedom": 99})):
        [one] = figures_of(kind, result, {})
        assert one.standard_uncertainty == pytest.approx(0.1)
        assert one.degrees_of_freedom == pytest.approx(freedom, rel=1e-6)
        least = 1.0 - t_quantile(1 - 0.025, freedom) * 0.1
        for limit, decision in ((least - 0.001, "pass"), (least + 0.001, "undecidable")):
            assert decide(one, Tolerance(limit, None), 0.025).decision == decision


@pytest.mark.parametrize(
    ("by", "freedom", "expected"),
    [((), {"gain_Nm": 2}, [2.0]), (("phase",), {"gain_Nm": [2, 3, 4]}, [2.0, 3.0, 4.0])],
)
def test_degrees_of_freedom_by_key_hold_for_rows(by, freedom, expected):
    kind = FigureKind("gain_Nm", summary="of another package", rows="rows", by=by)
    row = {"gain_Nm": [1.0] * 3, "gain_stderr_Nm": [0.1] * 3}
    row = row if by else {key: value[0] for key, value in row.items()}
    found = figures_of(kind, {"rows": [row], "degrees_of_freedom": freedom}, {})
    assert [one.degrees_of_freedom for one in found] == expected


@pytest.mark.parametrize(
    ("stated", "half_Nm"),
    [
        ({"gain_stderr_Nm": 0.01, "gain_uncertainty_Nm": 0.1}, 0.1 * coverage_factor()),
        ({"gain_stderr_Nm": 0.1, "gain_uncertainty_Nm": 0.01}, 0.1 * coverage_factor()),
        ({"gain_half_width_Nm": 0.5, "gain_low_Nm": 0.98, "gain_high_Nm": 1.02}, 0.5),
        ({"gain_half_width_Nm": 0.02, "gain_low_Nm": 0.5, "gain_high_Nm": 1.5}, 0.5),
        ({"gain_interval_95_Nm": [0.98, 1.02], "gain_low_Nm": 0.5, "gain_high_Nm": 1.5}, 0.5),
        ({"gain_interval_95_Nm": [None, 1.02], "gain_low_Nm": 0.5, "gain_high_Nm": 1.5}, 0.5),
        ({"gain_interval_95_Nm": [0.5, 1.5], "gain_low_Nm": 0.98, "gain_high_Nm": 1.02}, 0.5),
        ({"gain_interval_95_Nm": [0.5, 1.5], "gain_low_Nm": None, "gain_high_Nm": 1.02}, 0.5),
        ({"gain_interval_95_Nm": [0.98, 1.02], "gain_half_width_Nm": 0.5}, 0.5),
    ],
)
def test_of_errors_that_contradict_each_other_the_larger_counts(stated, half_Nm):
    for row in ({"gain_Nm": 1.0, **stated}, {**stated, "gain_Nm": 1.0}):
        [one] = figures_of(GAIN, {"gain_stderr_Nm": 0.01, **row}, {})
        assert one.expanded_uncertainty == pytest.approx(half_Nm)


@pytest.mark.parametrize("name", ["degrees_of_freedom", "freedom", "gain_degrees_of_freedom"])
@pytest.mark.parametrize("freedom", [float("nan"), "2", [2], True, {"gain_Nm": "2"}])
def test_degrees_of_freedom_that_are_no_number_are_the_fewest(name, freedom):
    [one] = figures_of(GAIN, {"gain_Nm": 1.0, "gain_stderr_Nm": 0.1, name: freedom}, {})
    assert one.degrees_of_freedom == 1.0


@pytest.mark.parametrize("freedom", [None, float("inf"), {"other_Nm": 2}, {"gain_Nm": None}])
def test_degrees_of_freedom_that_are_not_stated_or_endless_are_many(freedom):
    stated = {"gain_Nm": 1.0, "gain_stderr_Nm": 0.1, "degrees_of_freedom": freedom}
    [one] = figures_of(GAIN, stated, {})
    assert one.degrees_of_freedom is None


def test_an_interval_that_one_degree_of_freedom_does_not_explain_counts_as_if_it_were_alone():
    stated = {"gain_stderr_Nm": 0.1, "gain_half_width_Nm": 0.2 * coverage_factor(1)}
    for more in ({}, {"degrees_of_freedom": 1}, {"gain_degrees_of_freedom": 9}):
        [one] = figures_of(GAIN, {"gain_Nm": 1.0, **stated, **more}, {})
        assert one.expanded_uncertainty == pytest.approx(0.2 * coverage_factor(1))
        assert not one.freedom_known


@pytest.mark.parametrize("stderr_Nm", [{}, {"gain_stderr_Nm": 0.0}, {"gain_stderr_Nm": 0.01}])
def test_a_budget_does_not_narrow_such_an_interval(stderr_Nm):
    """By Welch and Satterthwaite one degree of freedom and a Type B were as good as many."""
    kind = replace(GAIN, budget="delta_epsilon")
    result = {
        "gain_Nm": 1.0,
        "gain_half_width_Nm": 0.2,
        **stderr_Nm,
        "budget": [contribution("B", 0.05)],
    }
    [one] = figures_of(kind, result, {})
    assert one.expanded_uncertainty > 0.2


@pytest.mark.parametrize("freedom", ["x", float("nan"), [2]])
def test_degrees_of_freedom_that_are_no_number_make_no_interval_known(freedom):
    stated = {"gain_Nm": 1.0, "gain_half_width_Nm": 0.2, "degrees_of_freedom": freedom}
    [one] = figures_of(GAIN, stated, {})
    assert (one.expanded_uncertainty, one.freedom_known) == (pytest.approx(0.2), False)


@pytest.mark.parametrize(
    ("freedom", "expected"),
    [
        ("2", [1.0] * 3),
        ({"gain": "2"}, [1.0] * 3),
        ([2], [2.0, 1.0, 1.0]),
        ([2, None, 3], [2.0, None, 3.0]),
    ],
)
def test_degrees_of_freedom_that_are_no_number_are_the_fewest_of_phases_too(freedom, expected):
    kind = FigureKind("gain", summary="of another package", by=("phase",))
    result = {"gain": [1.0] * 3, "gain_stderr": [0.1] * 3, "degrees_of_freedom": freedom}
    assert [one.degrees_of_freedom for one in figures_of(kind, result, {})] == expected


def test_degrees_of_freedom_by_key_do_not_hide_those_around_for_other_keys():
    kind = replace(GAIN, rows="rows")
    row = {"gain_Nm": 1.0, "gain_stderr_Nm": 0.1, "degrees_of_freedom": {"other_Nm": 2}}
    [one] = figures_of(kind, {"rows": [row], "degrees_of_freedom": 3}, {})
    assert one.degrees_of_freedom == 3.0


@pytest.mark.parametrize("more", [{}, {"degrees_of_freedom": 5}, {"gain_degrees_of_freedom": 50}])
@pytest.mark.parametrize("stderr_Nm", [0.0, 1e-9])
def test_an_interval_around_no_error_is_not_narrowed(stderr_Nm, more):
    stated = {"gain_Nm": 1.0, "gain_stderr_Nm": stderr_Nm, **more}
    [one] = figures_of(GAIN, {**stated, "gain_half_width_Nm": 0.2}, {})
    assert one.expanded_uncertainty == pytest.approx(0.2)
    assert decide(one, Tolerance(0.81, None), 0.025).decision == "undecidable"
    [none] = figures_of(GAIN, {**stated, "gain_stderr_Nm": 0.0, "gain_half_width_Nm": 0.0}, {})
    assert decide(none, Tolerance(0.5, None), 0.025).reason == "its uncertainty is not stated"


@pytest.mark.parametrize(
    "stated",
    [
        *({"gain_half_width_Nm": one} for one in (float("inf"), float("nan"), -0.2, "9", [0.1])),
        *({"gain_uncertainty_Nm": one} for one in (float("inf"), float("nan"), -1e-9, "9", True)),
        *({"gain_interval_95_Nm": one} for one in (0.5, [0.2], ["0", "2"], [1.2, 0.8])),
        {"gain_low_Nm": 1.2, "gain_high_Nm": 0.8},
        {"gain_low_Nm": float("-inf"), "gain_high_Nm": float("inf")},
    ],
)
def test_with_what_can_be_no_error_no_error_counts(stated):
    """An infinite half-width next to a standard error of 0.001 did not count: the figure passed."""
    [one] = figures_of(GAIN, {"gain_Nm": 1.0, "gain_stderr_Nm": 0.001, **stated}, {})
    found = decide(one, Tolerance(0.5, 1.5), 0.025)
    assert (found.decision, found.reason) == ("undecidable", "its uncertainty is not stated")


@pytest.mark.parametrize("ends", [{"gain_high_Nm": 5.0}, {"gain_low_Nm": -3.0}])
@pytest.mark.parametrize("other", [{}, {"gain_low_Nm": None}, {"gain_high_Nm": None}])
def test_one_end_of_an_interval_counts_next_to_a_standard_error(ends, other):
    [one] = figures_of(GAIN, {"gain_Nm": 1.0, "gain_stderr_Nm": 0.001, **other, **ends}, {})
    assert one.expanded_uncertainty == pytest.approx(4.0)
    [alone] = figures_of(GAIN, {"gain_Nm": 1.0, **other, **ends}, {})
    assert alone.standard_uncertainty is None


@pytest.mark.parametrize("freedom", [0, -3, 0.5, float("-inf")])
def test_degrees_of_freedom_below_one_are_one_and_of_an_interval_alone_not_known(freedom):
    """They made the standard uncertainty a sixth of what the interval says."""
    stated = {"gain_Nm": 1.0, "degrees_of_freedom": freedom}
    [alone] = figures_of(GAIN, {**stated, "gain_half_width_Nm": 0.2}, {})
    assert (alone.degrees_of_freedom, alone.freedom_known) == (None, False)
    [one] = figures_of(GAIN, {**stated, "gain_stderr_Nm": 0.1}, {})
    assert one.degrees_of_freedom == 1.0


@pytest.mark.parametrize(("of_result", "expected"), [({}, 2.0), ({"degrees_of_freedom": 1.5}, 1.5)])
def test_type_a_of_a_budget_has_the_degrees_of_freedom_of_the_budget(of_result, expected):
    """It counted as of many, if the result stated none: a figure of two passed."""
    kind = replace(GAIN, budget="delta_epsilon")
    of_data = {**contribution("A", 0.1), "degrees_of_freedom": [9, 9, 2, 9]}
    [one] = figures_of(kind, {"gain_Nm": 1.0, "budget": [of_data], **of_result}, {})
    assert (one.standard_uncertainty, one.degrees_of_freedom) == pytest.approx((0.1, expected))


def test_a_half_width_alone_decides_nothing():
    [one] = figures_of(GAIN, {"gain_Nm": 1.0, "gain_half_width_Nm": 0.2}, {})
    assert one.expanded_uncertainty == pytest.approx(0.2)
    assert not one.freedom_known


def test_degrees_of_freedom_of_the_result_hold_for_each_phase():
    kind = FigureKind("gain", summary="of another package", by=("phase",))
    result = {"gain": [1.0, 2.0, 3.0], "gain_stderr": [0.1, 0.2, 0.3], "degrees_of_freedom": 2}
    assert [one.degrees_of_freedom for one in figures_of(kind, result, {})] == [2.0, 2.0, 2.0]


def test_an_interval_alone_decides_nothing_at_a_risk_that_it_may_not_keep():
    """Of three coast-downs at a risk of 0.1 %, 1 % of motors at their limit would pass."""
    one = coulomb(0.01)
    assert decide(one, Tolerance(None, 1.0), 0.025).decision == "pass"
    found = decide(one, Tolerance(None, 1.0), 0.001)
    assert (found.decision, found.reason) == (
        "undecidable",
        "the degrees of freedom of its interval are not stated",
    )


def test_a_serious_finding_is_a_doubt_about_every_figure_and_a_warning_is_not():
    bad, warning = (
        {"name": name, "severity": severity}
        for name, severity in (("encoder-zero", "serious"), ("few-points", "warning"))
    )
    found = of("calibrate", "alpha", calibration(findings=[warning, bad, bad]))
    assert {one.doubt for one in found} == {"serious finding encoder-zero"}
    assert not of("calibrate", "alpha", calibration(findings=[warning]))[0].doubt
    [gone] = of("calibrate", "cogging_Nm", calibration(findings=[bad]), order=49)
    assert gone.doubt


@pytest.mark.parametrize("value", [None, True, "1.0", float("nan"), [1.0]])
def test_what_is_no_number_is_no_value(value):
    [one] = of("inertia", "inertia_kg_m2", {"inertia_kg_m2": value, "uncertainty_kg_m2": 0.1})
    assert one.value is None


def test_the_freedom_of_the_result_holds_for_its_rows():
    result = {
        "harmonics": [{"order": 48, "amplitude_Nm": 0.3, "stderr_Nm": 0.01}],
        "degrees_of_freedom": 9,
    }
    [one] = of("cogging", "cogging_Nm", result)
    assert one.degrees_of_freedom == pytest.approx(9.0)
    assert one.expanded_uncertainty == pytest.approx(0.022622, abs=1e-6)  # t(9) = 2.2622
