"""Steps of a series: found with place and size, and not taken for what is none."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from motord.experiments.analysis import encode
from motord.experiments.soak.figure_trends import with_steps
from motord.experiments.soak.result import FigureTrend, Repetition, SoakResult
from motord.experiments.soak.step import FALSE_ALARMS, LEAST, most_likely_step
from motord.experiments.soak.trend import slope
from motord.intervals import beyond_chance
from motord.results.figures import figures
from tests.unit.experiments.soak.test_trend import wandering

HOURS = np.linspace(0.0, 5.0, 50)
SEEDS = 40


def trend(values: np.ndarray, name: str = "x_Nm") -> FigureTrend:
    return FigureTrend(name, "Nm", HOURS, values, slope(HOURS, values))


def others() -> list[np.ndarray]:
    """Return 11 figures of a soak without a step."""
    rng = np.random.default_rng(99)
    return [rng.normal(size=HOURS.size) for _ in range(11)]


@cache
def p_values_of_others() -> list[float | None]:
    found = [most_likely_step(HOURS, one) for one in others()]
    return [one and one.p_value for one in found]


def stepped(values: np.ndarray) -> bool:
    found = most_likely_step(HOURS, values)
    return beyond_chance([found and found.p_value, *p_values_of_others()], FALSE_ALARMS)[0]


def test_a_step_is_found_with_its_place_and_size_and_is_no_slope():
    after = np.arange(HOURS.size) >= 20
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        [found] = with_steps([trend(7.0 + 10.0 * after + wandering(rng, HOURS.size, 0.3))])
        assert found.step.place == 20
        assert HOURS[19] < found.step.hours < HOURS[20]
        assert abs(found.step.value - 10.0) < 2 * found.step.half_width
        assert found.slope.p_value > 1e-3


def test_a_step_is_judged_together_with_all_figures_of_the_soak():
    noise = np.random.default_rng(5).normal(size=HOURS.size)
    one = trend(noise + 2.75 * (np.arange(HOURS.size) >= 20))
    [alone], [among, *_] = with_steps([one]), with_steps([one, *map(trend, others())])
    assert FALSE_ALARMS / 12 < alone.step.p_value < FALSE_ALARMS
    assert among.step is None


def test_a_step_and_a_slope_are_separated():
    values = 10.0 * (HOURS > 2.0) - 3.0 * HOURS
    covers = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        [found] = with_steps([trend(values + rng.normal(size=HOURS.size))])
        covers += abs(found.slope.value + 3.0) <= found.slope.half_width
    assert covers >= 90


@pytest.mark.parametrize("kind", ["line", "warm-up", "cycle", "outlier", "readings in steps"])
def test_what_changes_otherwise_is_no_step(kind):
    part, claimed = HOURS / HOURS[-1], 0
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        noise = rng.normal(size=HOURS.size)
        values = {
            "line": 10 * part + noise,
            "warm-up": 100 * (1 - np.exp(-part / 0.1)) + noise,
            "cycle": 10 * np.sin(4 * np.pi * part + seed) + noise,
            "outlier": 20.0 * (np.arange(HOURS.size) == rng.integers(HOURS.size)) + noise,
            "readings in steps": np.round(0.3 * part + rng.uniform() + 0.01 * noise),
        }[kind]
        claimed += stepped(values)
    assert claimed <= 2


def test_a_slight_warm_up_is_no_step():
    claimed = 0
    for seed in range(SEEDS):
        noise = np.random.default_rng(seed).normal(size=HOURS.size)
        found = most_likely_step(HOURS, 6.0 * (1 - np.exp(-HOURS / 0.5)) + noise)
        claimed += found.p_value < FALSE_ALARMS
    assert claimed <= 1  # 0; 22 by the p-value next to a line alone


@pytest.mark.parametrize(("n", "correlation"), [(10, 0.0), (12, 0.5), (50, 0.8), (50, 0.95)])
def test_without_a_step_few_soaks_claim_one(n, correlation):
    rng, at = np.random.default_rng([n, round(100 * correlation)]), np.linspace(0.0, 1.0, n)

    def p_value() -> float | None:
        found = most_likely_step(at, wandering(rng, n, correlation))
        return found and found.p_value

    claimed = [any(beyond_chance([p_value() for _ in range(6)], FALSE_ALARMS)) for _ in range(100)]
    assert sum(claimed) <= 4  # 1, and 3 standard deviations


def test_the_interval_of_a_step_holds_for_readings_in_steps():
    found = covers = 0
    for seed in range(100):
        rng, after = np.random.default_rng(seed), np.arange(HOURS.size) >= 25
        size, rise = rng.uniform(3.0, 6.0), rng.uniform(-0.2, 0.2)
        values = 20.0 + rng.uniform() + rise * HOURS + size * after
        step = most_likely_step(HOURS, np.round(values + 0.05 * rng.normal(size=HOURS.size)))
        if step is not None and step.p_value < FALSE_ALARMS:
            found += 1
            covers += abs(step.value - size) <= step.half_width
    assert found >= 40
    assert covers >= 0.94 * found


def test_of_few_or_equal_values_no_step_is_stated():
    few = np.arange(LEAST - 1.0)
    assert most_likely_step(few, few**2) is None
    assert most_likely_step(HOURS, np.full(HOURS.size, 3.0)) is None


@pytest.mark.parametrize(
    ("figure", "name"),
    [
        ("torque_mean_Nm of point 1, 1 Nm, 1 Hz", "torque-mean-nm"),
        ("winding_C", "winding-c"),
        ("channel torque_zero_Nm", "channel-torque-zero-nm"),
    ],
)
def test_a_finding_has_the_name_of_its_figure_without_the_point(figure, name):
    values = np.random.default_rng(3).normal(size=HOURS.size) + 10.0 * (HOURS > 2.5)
    found = SoakResult("verify", (), tuple(with_steps([trend(values, figure)])))
    assert [one.name for one in found.findings] == [f"step-of-{name}"]


def test_set_points_of_one_figure_share_a_finding_that_names_them_all():
    """Findings of one name are one: a consumer could not tell which is which."""
    rng, late = np.random.default_rng(3), HOURS > 2.5
    changes = {"of point 1": 10.0 * late, "of point 2": 30.0 * late, "of point 3": 0.0 * HOURS}
    trends = [
        trend(rng.normal(size=HOURS.size) + change, f"torque_mean_Nm {point}")
        for point, change in changes.items()
    ]
    two = Repetition(0, "a", 0.0, 3, complete=True), Repetition(1, "a", 5.0, 3, complete=True)
    stepped = SoakResult("verify", two, tuple(with_steps(trends)))
    drifting = SoakResult("verify", two, tuple(replace(one, drifts=True) for one in trends[:2]))
    for found, what in ((stepped, "step"), (drifting, "drift")):
        [finding] = (one for one in found.findings if one.name == f"{what}-of-torque-mean-nm")
        assert finding.meaning.startswith("torque_mean_Nm of point 2 ")
        assert "; so do torque_mean_Nm of point 1 by " in finding.meaning
        assert "point 3" not in finding.meaning
    assert abs(stepped.findings[0].value - 30.0) < stepped.findings[0].limit


def test_a_soak_says_what_changed_at_once():
    rng = np.random.default_rng(3)
    after = np.arange(HOURS.size) >= 25
    trends = [
        trend(rng.normal(size=HOURS.size) + 10.0 * after, "torque_mean_Nm of point 1"),
        trend(rng.normal(size=HOURS.size)),
    ]
    found = SoakResult("verify", (), tuple(with_steps(trends)))
    stored = {one.field: one for one in figures({"trends": encode(found.trends)})}
    step = stored["trends.torque_mean_Nm of point 1.step"]
    assert (step.unit, step.low < 10.0 < step.high) == ("Nm", True)
    [finding] = found.findings
    assert finding.name == "step-of-torque-mean-nm"
    assert finding.meaning.startswith("torque_mean_Nm of point 1 changed by")
    assert "at once, 2.5 h after the first repetition" in finding.meaning
