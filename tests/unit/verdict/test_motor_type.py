"""The file of a motor type: what is wrong with it is one message with line and field."""

from pathlib import Path

import pytest

from motord.config import ConfigError
from motord.config.experiments import analysis_kinds
from motord.verdict.figures import judge
from motord.verdict.motor_type import analysis_of, load_motor_type
from tests.unit.verdict.made_up import calibration

GOOD = """
motor = "M"
risk_percent = 5

[[plan]]
name = "calibrate"
settings = {time_limit_s = 30.0}

[[limit]]
analysis = "calibrate"
figure = "alpha"
low = 0.7
high = 1.3

[[limit]] # of the main order
analysis = "calibrate"
figure = "cogging_Nm"
at = {order = 48}
unit = "Nm"
high = 0.3
"""


def load(folder: Path, *changes: tuple[str, str]):
    text = GOOD
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / "type.toml"
    path.write_text(text)
    return load_motor_type(path)


def test_what_it_says(tmp_path):
    kind = load(tmp_path)
    assert (kind.motor, kind.risk) == ("M", 0.05)
    assert kind.plan[0].settings == {"time_limit_s": 30.0}
    assert (kind.limit[0].low, kind.limit[1].low, kind.limit[1].high) == (0.7, None, 0.3)
    assert load(tmp_path, ("risk_percent = 5\n", "")).risk == 0.025


@pytest.mark.parametrize(
    ("old", "new", "line", "said"),
    [
        ("high = 0.3", "high = 0.3\nlow = 0.3", 15, "low = 0.3 is not below high = 0.3"),
        ("high = 0.3", "low = nan", 20, "limit[1].low: input should be a finite number"),
        ("high = 0.3", "hgh = 0.3", 20, "limit[1].hgh: unknown key; did you mean high?"),
        ("high = 0.3", "", 15, "cogging_Nm: neither low nor high is given"),
        ("high = 0.3", 'high = "x"', 20, "limit[1].high: input should be a valid number, got 'x'"),
        ('unit = "Nm"', 'unit = "mNm"', 15, "cogging_Nm: unit is 'mNm', that of the figure 'Nm'"),
        ('"alpha"', '"alpha"\nunit = "A"', 9, "alpha: unit is 'A', that of the figure none"),
        ('"alpha"', '"alhpa"', 9, "calibrate has no figure 'alhpa'; it has: alpha, alpha_spread"),
        ("order = 48", "phase = 48", 15, "at has phase; the figure is separated by order"),
        ('"alpha"', '"delta_epsilon"\nat = {phase = "a"}', 9, "separated by nothing"),
        ("order = 48", 'order = "48"', 15, "at order = '48': a number is needed"),
        ('"alpha"', '"alpha"\nat = {phase = "A"}', 9, "at phase = 'A': one of a, b, c"),
        ('"calibrate"\nfigure', '"learn"\nfigure', 9, "analysis 'learn' states no figure"),
        ('name = "calibrate"', 'name = "calib"', 5, "plan[0]: no plan 'calib'; there are: "),
        ("time_limit_s", "time_limit", 5, "calibrate: setting time_limit: is not known"),
        ("= 5", "= 50", 3, "risk_percent: input should be less than 50, got 50"),
        ("= 5", "= 0", 3, "risk_percent: input should be greater than 0"),
        ('motor = "M"', 'moter = "M"', 2, "moter: unknown key; did you mean motor?"),
        ('motor = "M"', 'motor = ""', 2, "motor: string should have at least 1 character"),
        ('name = "calibrate"\nsettings = {time_limit_s = 30.0}', 'name = "cogging"', 0,
         "limit of alpha, and no [[plan]] is analysed by calibrate"),
        ("[[limit]]", '[[plan]]\nname = "calibrate"\n[[limit]]', 0,
         "2 plans are analysed by calibrate"),
        ('"cogging_Nm"\nat = {order = 48}\nunit = "Nm"', '"alpha"', 0,
         "2 limits of calibrate alpha at the same place"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_with_its_line(old, new, line, said, tmp_path):
    with pytest.raises(ConfigError) as raised:
        load(tmp_path, (old, new))
    [complaint] = (one for one in raised.value.lines if said in one)
    assert f"type.toml{f':{line}' if line else ''}: " in complaint
    assert all("type.toml" in one for one in raised.value.lines)


def test_no_limits_are_refused(tmp_path):
    with pytest.raises(ConfigError, match="limit: missing"):
        load(tmp_path, (GOOD[GOOD.index("[[limit]]") :], ""))


def test_every_figure_can_have_limits(tmp_path):
    for kind in analysis_kinds().values():
        for figure in kind.figures:
            path = tmp_path / "one.toml"
            path.write_text(
                f'motor = "M"\n[[limit]]\nanalysis = "{kind.name}"\nfigure = "{figure.name}"\n'
                f'unit = "{figure.unit}"\nhigh = 1\n'
            )
            assert load_motor_type(path).limit[0].kind == figure


def test_recordings_of_a_plan_find_their_analysis():
    found = analysis_of("inertia-oscillation")
    assert found is not None
    assert found.name == "inertia"
    assert analysis_of("") is None


def test_all_limits_are_judged_also_those_without_a_recording(tmp_path):
    kind = load(tmp_path, ('"calibrate"\nsettings = {time_limit_s = 30.0}', '"calibrate"'))
    verdict = judge(kind, {"calibrate": calibration()})
    assert [one.figure.name for one in verdict.figures] == [
        "alpha, phase a", "alpha, phase b", "alpha, phase c", "cogging_Nm, order 48",
    ]  # fmt: skip
    assert [one.decision for one in verdict.figures] == ["pass"] * 3 + ["undecidable"]
    nothing = judge(kind, {})
    assert nothing.decision == "undecidable"
    assert {one.reason for one in nothing.figures} == {"there is no recording for calibrate"}


@pytest.mark.parametrize(("risk", "decision"), [("2.5", "undecidable"), ("5", "pass")])
def test_the_stated_risk_decides(risk, decision, tmp_path):
    """0.3 of high 0.3094: 1.88 standard uncertainties with 23 degrees of freedom, 3.6 %."""
    changes = (("= 5", f"= {risk}"), ("high = 0.3\n", "high = 0.3094\n"))
    [*_, cogging] = judge(load(tmp_path, *changes), {"calibrate": calibration()}).figures
    assert 1 - cogging.probability == pytest.approx(0.0364, abs=3e-4)
    assert cogging.decision == decision
