"""The test of a calibration by fresh turns: what it finds, would find, and refuses."""

import json
import re
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from motord.calibration import Calibration, CalibrationError
from motord.cli.analysis_command import app as analyse
from motord.config import Config, load, packaged
from motord.experiments.captures_left_out import CapturesLeftOut
from motord.experiments.check_calibration.estimate import check
from motord.experiments.check_calibration.result import CalibrationCheck
from motord.experiments.plans import build
from motord.experiments.subject import Subject
from motord.identification import IdentifyError
from motord.identification.operating_points import PointData, split
from motord.intervals import t_quantile
from motord.recording.metadata import describe
from motord.recording.writer import RunWriter
from motord.rig.truth import RigTruth
from motord.rig.truth import load as load_truth
from motord.virtual import VirtualBench, run_plan
from tests.campaigns.check_calibration import stated_calibration, with_drift
from tests.campaigns.estimator import rig
from tests.unit.experiments.test_cli import run

SEED = 1


@dataclass(frozen=True)
class Taken:
    """A check on a rig: all ticks, the points as they were taken, the calibration in force."""

    config: Config
    calibration: Calibration
    ticks: np.ndarray
    recorded: list[dict]

    @property
    def points(self) -> list[PointData]:
        return list(split(self.ticks, self.recorded))

    def record(self, path: Path, calibration_id: str) -> Path:
        metadata = describe(
            self.config, packaged("sim.toml").read_text(), calibration_id=calibration_id
        )
        with RunWriter(path, metadata) as writer:
            writer.ticks(self.ticks)
            for point in self.recorded:
                writer.operating_point(int(point["t_end_ns"]), point)
        return path

    def checked(self, **changes: object) -> CalibrationCheck:
        given = {
            "points": self.points,
            "calibration": self.calibration,
            "needed_percent": 0.2,
            "left_out": CapturesLeftOut(),
        }
        return check(subject=Subject.of_config(self.config), **{**given, **changes})


def take(
    truth: RigTruth,
    config: Config | None = None,
    calibration: Calibration | None = None,
    **settings: object,
) -> Taken:
    config, blocks = config or load(), []
    calibration = calibration or stated_calibration(SEED, config)
    virtual = VirtualBench(config, truth, SEED, calibration)
    plan = build("check-calibration", config, settings)
    recorded = run_plan(virtual, plan, lambda ticks, _: blocks.append(ticks))
    return Taken(config, calibration, np.concatenate(blocks), recorded)


@cache
def drifted(phase: int) -> Taken:
    """Return a check on a rig of which one gain has drifted by 0.4 %."""
    return take(with_drift(rig(SEED)[0], phase, 0.004))


@pytest.fixture(scope="module")
def unchanged() -> Taken:
    return take(rig(SEED)[0])


def test_signals_that_show_nothing_are_no_verdict(unchanged: Taken) -> None:
    inside = unchanged.ticks["torque_Nm"][unchanged.ticks["plan_point"] >= 0]
    for low, high, why in (
        (-np.inf, 0.8 * inside.max(), "torque_Nm is cut off at an end of its range"),
        (0.1, 0.1, r"torque_Nm is 0\.1 from the first sample to the last"),
    ):
        ticks = unchanged.ticks.copy()
        ticks["torque_Nm"] = np.clip(ticks["torque_Nm"], low, high)
        with pytest.raises(IdentifyError, match=why):
            replace(unchanged, ticks=ticks).checked()


def test_an_encoder_that_is_misread_gives_no_verdict(unchanged: Taken) -> None:
    for every in (97, 500):
        ticks = unchanged.ticks.copy()
        ticks["encoder_count"][::every] ^= 256
        with pytest.raises(
            IdentifyError, match="encoder_count jumps for single samples or a few in a row"
        ):
            replace(unchanged, ticks=ticks).checked()


def test_a_count_out_of_range_is_left_out_and_said(unchanged: Taken) -> None:
    ticks = unchanged.ticks.copy()
    ticks["encoder_count"][ticks.size // 2] = 65535
    found = replace(unchanged, ticks=ticks).checked()
    assert [one.name for one in found.more_findings] == ["encoder-out-of-range"]
    assert found.drifted == ()


def inverter(truth: RigTruth, **changes: object) -> RigTruth:
    return truth.model_copy(update={"inverter": truth.inverter.model_copy(update=changes)})


def louder(truth: RigTruth, order: int, factor: float) -> RigTruth:
    waves = tuple(
        one.model_copy(update={"amplitude_Nm": factor * one.amplitude_Nm})
        if one.order == order
        else one
        for one in truth.motor.cogging
    )
    motor = truth.motor.model_copy(update={"cogging": waves})
    return truth.model_copy(update={"motor": motor})


def test_a_calibration_that_holds_is_valid_and_the_power_is_stated(unchanged: Taken) -> None:
    found = unchanged.checked()
    assert found.verdict == "valid"
    assert found.findings == ()
    assert found.turns == (3, 2, 3)
    assert 0.5 < found.misfit < 1.5
    gains = found.changes[:3]
    assert [one.name for one in gains] == ["gain-a", "gain-b", "gain-c"]
    assert all(0.15 < one.detectable < 0.3 for one in gains)
    assert all(0.5 * one.detectable < one.limit < one.detectable for one in found.changes)
    shared = t_quantile(1 - 0.005 / 2 / len(found.changes), gains[0].degrees_of_freedom)
    assert gains[0].limit == pytest.approx(shared * gains[0].stderr)
    largest = max(one.detectable for one in gains)
    assert f"a change of a phase's gain by {largest:.2g} %, of an offset by " in found.sentence
    assert "is found in 95 % of such checks" in found.sentence


@pytest.mark.parametrize("phase", [0, 1, 2])
def test_a_drift_of_one_gain_is_found_and_its_phase_named(phase: int) -> None:
    found = drifted(phase).checked()
    assert [one.name for one in found.drifted] == [f"gain-{'abc'[phase]}"]
    assert found.drifted[0].value == pytest.approx(0.4, abs=0.15)
    assert found.findings[0].name == f"calibration-drifted-gain-{'abc'[phase]}"
    assert found.findings[0].value > found.findings[0].limit
    assert found.sentence.startswith(f"drifted: calibration {found.calibration}")


def test_in_a_star_the_gains_are_tested_by_kirchhoffs_law() -> None:
    config = load()
    motor = config.motor.model_copy(update={"connection": "star"})
    config = config.model_copy(update={"motor": motor})
    truth = load_truth(packaged("star.rig.toml"))
    calibration = stated_calibration(SEED, config, (truth, 1.0, truth.inverter.epsilon))
    valid = take(truth, config, calibration).checked()
    assert valid.verdict == "valid"
    off = 100 * np.log(np.divide(truth.inverter.alpha, calibration.alpha))
    found = [one.value for one in valid.changes[:3]]
    assert found == pytest.approx(1.5 * (off - off.mean()), abs=0.02)
    drifted = take(with_drift(truth, 1, -0.003), config, calibration).checked()
    assert [one.name for one in drifted.drifted] == ["gain-b"]
    step = drifted.changes[1].value - valid.changes[1].value
    assert step == pytest.approx(-0.3, abs=0.02)


def test_two_gains_that_drift_are_both_named() -> None:
    truth = with_drift(with_drift(rig(SEED)[0], 1, 0.01), 2, -0.006)
    found = take(truth).checked()
    assert {"gain-b", "gain-c"} <= {one.name for one in found.drifted}
    assert "gain-a" not in {one.name for one in found.drifted}


def test_offset_cogging_and_common_gain_that_change_are_named() -> None:
    truth = rig(SEED)[0]
    a, b, c = truth.inverter.beta_A
    cases = {
        "offset-b": inverter(truth, beta_A=(a, b + 0.06, c)),
        "cogging-48-amplitude": louder(truth, 48, 1.05),
        "gain-common": inverter(truth, epsilon=1.02 * truth.inverter.epsilon),
    }
    for name, changed in cases.items():
        assert [one.name for one in take(changed).checked().drifted] == [name]


def test_errors_that_the_calibration_states_are_no_drift() -> None:
    taken = drifted(0)
    unsure = taken.calibration.model_copy(update={"alpha_stderr": (2e-3, 2e-3, 2e-3)})
    found = taken.checked(calibration=unsure, needed_percent=0.5)
    assert found.verdict == "valid"
    assert found.changes[0].detectable > 1.0


def test_a_check_that_sees_too_little_is_undecided_and_says_what(unchanged: Taken) -> None:
    found = unchanged.checked(needed_percent=0.01)
    assert found.verdict == "undecided"
    assert [one.name for one in found.findings] == ["change-not-seen"]
    assert found.sentence.startswith("undecided: ")


def test_a_torque_that_no_parameter_explains_is_undecided(unchanged: Taken) -> None:
    config = load()
    motor = config.motor.model_copy(update={"encoder_offset_rad": 0.004})
    found = replace(unchanged, config=config.model_copy(update={"motor": motor})).checked()
    assert "torque-not-as-modelled" in [one.name for one in found.findings]


def test_one_direction_at_one_torque_does_not_separate_gains_from_cogging() -> None:
    taken = take(rig(SEED)[0], turns=5)
    found = taken.checked(points=taken.points[:2])
    assert found.verdict == "undecided"
    assert found.findings[0].name == "not-tested"
    assert "in both directions; if they are, more of them" in found.findings[0].action
    assert not {"gain-a", "gain-b", "gain-c"} & {one.name for one in found.changes}


def test_cogging_that_a_calibration_does_not_state_is_not_tested(unchanged: Taken) -> None:
    stated = unchanged.calibration.tau_cog_harmonics
    waves = tuple(one.model_copy(update={"stderr_Nm": None}) for one in stated)
    assumed = {"tau_cog_harmonics": waves, "delta_epsilon_source": "assumed"}
    found = unchanged.checked(calibration=unchanged.calibration.model_copy(update=assumed))
    assert {one.name.split("-")[0] for one in found.changes} == {"gain", "offset"}
    assert "gain-common" not in {one.name for one in found.changes}


def test_an_order_that_the_ticks_do_not_resolve_is_named_as_not_tested(unchanged: Taken) -> None:
    stated = unchanged.calibration.tau_cog_harmonics
    fine = stated[0].model_copy(update={"order": 400, "amplitude_Nm": 0.0})
    more = unchanged.calibration.model_copy(update={"tau_cog_harmonics": (*stated, fine)})
    found = unchanged.checked(calibration=more)
    assert found.unseen == ("order 400 of the cogging torque",)
    assert found.verdict == "valid"
    applied = fine.model_copy(update={"amplitude_Nm": 0.01})
    more = unchanged.calibration.model_copy(update={"tau_cog_harmonics": (*stated, applied)})
    assert unchanged.checked(calibration=more).verdict == "undecided"


def test_too_few_turns_are_refused(unchanged: Taken) -> None:
    with pytest.raises(IdentifyError, match="no good operating point"):
        unchanged.checked(points=[])
    with pytest.raises(IdentifyError, match="6 whole turns in all are too few"):
        unchanged.checked(points=unchanged.points[::2])


def test_a_point_of_one_turn_is_left_out_and_said(unchanged: Taken) -> None:
    """It ended the check of all the others."""
    short = replace(unchanged.points[0], ticks=unchanged.points[0].ticks[:1100])
    left_out = CapturesLeftOut()
    found = unchanged.checked(points=[short, *unchanged.points], left_out=left_out)
    assert found.turns == (3, 2, 3)
    assert "1 of the 2 whole turns that it needs" in left_out.reasons[0]


def test_a_calibration_of_another_motor_is_refused(unchanged: Taken) -> None:
    motor = unchanged.calibration.motor.model_copy(update={"serial": "other"})
    with pytest.raises(CalibrationError, match="was made for another motor"):
        unchanged.checked(calibration=unchanged.calibration.model_copy(update={"motor": motor}))


def test_a_calibration_that_names_no_serial_number_is_compared(unchanged: Taken) -> None:
    motor = unchanged.calibration.motor.model_copy(update={"serial": ""})
    nameless = unchanged.calibration.model_copy(update={"motor": motor})
    assert unchanged.checked(calibration=nameless).verdict == "valid"
    with pytest.raises(CalibrationError, match="serial is '' there"):  # to be put in force
        nameless.check_motor(load().motor)


def test_command_prints_the_verdict_and_writes_result_and_page(
    unchanged: Taken, tmp_path: Path
) -> None:
    calibration, page = tmp_path / "c.json", tmp_path / "page.html"
    unchanged.calibration.save(calibration)
    path = unchanged.record(tmp_path / "check.mcap", unchanged.calibration.id)
    arguments = ("check-calibration", path, "--calibration", calibration)
    code, out, _ = run(analyse, *arguments, "--report", page)
    assert code == 0
    assert f"valid: calibration {unchanged.calibration.id} still holds" in " ".join(out.split())
    assert "gain-a" in out
    text = page.read_text()
    assert "What changed since the calibration" in text
    assert re.search(r"\u00a0\u00b1\u00a0[\d.]+ [^<]+</b><span>largest change for its limit", text)
    code, out, _ = run(analyse, *arguments, "--json")
    content = json.loads(out)
    assert (code, content["verdict"], content["findings"]) == (0, "valid", [])
    first = content["changes"][0]
    assert first["name"] == "gain-a"
    assert abs(first["value"]) < first["limit"] < first["detectable"]


def test_a_recording_with_another_calibration_or_none_is_refused(
    unchanged: Taken, tmp_path: Path
) -> None:
    calibration = tmp_path / "c.json"
    unchanged.calibration.save(calibration)
    for applied, named in (("", "calibration none"), ("f" * 16, "f" * 16)):
        path = unchanged.record(tmp_path / f"{applied}.mcap", applied)
        code, _, err = run(analyse, "check-calibration", path, "--calibration", calibration)
        assert code == 1
        assert f"was taken with {named}" in " ".join(err.split()).replace("calibration f", "f")


def test_points_of_poor_quality_are_named_as_left_out(unchanged: Taken, tmp_path: Path) -> None:
    calibration = tmp_path / "c.json"
    unchanged.calibration.save(calibration)
    poor = [{**unchanged.recorded[0], "index": 3, "quality": "noisy: 9 frames lost or corrupt"}]
    taken = replace(unchanged, recorded=[*unchanged.recorded, *poor])
    path = taken.record(tmp_path / "poor.mcap", unchanged.calibration.id)
    code, out, _ = run(analyse, "check-calibration", path, "--calibration", calibration, "--json")
    assert code == 0
    assert [one["name"] for one in json.loads(out)["findings"]] == ["points-left-out"]
