"""What analyses say of recordings whose signals are dead, clipped, frozen or in another unit."""

import json
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from motord.cli.analysis_command import app as analyse
from tests.support.wrong_signals import CHANGES, Change, change_recording
from tests.unit.experiments.conftest import Recorded
from tests.unit.experiments.test_cli import run

pytestmark = pytest.mark.usefixtures("no_search_for_lines")


@pytest.fixture(scope="module")
def sound(recorded: Recorded) -> dict[str, Any]:
    """Return what analyses find in the recording as it is."""
    kinds = ("calibrate", "verify")
    return {kind: json.loads(run(analyse, kind, recorded.off, "--json")[1]) for kind in kinds}


def dead(ticks: np.ndarray) -> np.ndarray:
    ticks["torque_Nm"] = 0.1
    return ticks


def clipped(ticks: np.ndarray) -> np.ndarray:
    inside = np.abs(ticks["torque_Nm"][ticks["plan_point"] >= 0])
    end = 0.85 * float(inside.max())
    ticks["torque_Nm"] = np.clip(ticks["torque_Nm"], -end, end)
    return ticks


def frozen(ticks: np.ndarray) -> np.ndarray:
    [place] = np.nonzero(ticks["plan_point"] == 1)
    ticks["torque_Nm"][place[1000:2500]] = ticks["torque_Nm"][place[1000]]
    return ticks


def stuck(bit: int, ticks: np.ndarray) -> np.ndarray:
    ticks["encoder_count"] |= 1 << bit
    return ticks


def clipped_current(ticks: np.ndarray) -> np.ndarray:
    inside = np.abs(ticks["i_b_A"][ticks["plan_point"] >= 0])
    end = 0.95 * float(inside.max())
    ticks["i_b_A"] = np.clip(ticks["i_b_A"], -end, end)
    return ticks


def uncommanded(ticks: np.ndarray) -> np.ndarray:
    ticks["i_cmd_b_A"] = 0.0
    return ticks


@pytest.mark.parametrize(
    ("kind", "change", "finding"),
    [
        ("calibrate", clipped, "torque-clipped"),
        ("calibrate", clipped_current, "current-b-clipped"),
        ("calibrate", partial(stuck, 4), "encoder-stuck"),
        ("verify", frozen, "torque-frozen"),
        ("verify", CHANGES["torque in mNm"], "torque-scale"),
        ("verify", CHANGES["encoder misread at times"], "encoder-misread"),
    ],
)
def test_a_serious_finding_names_the_signal(
    recorded: Recorded, tmp_path: Path, kind: str, change: Change, finding: str
) -> None:
    path = change_recording(recorded.off, tmp_path / "run.mcap", change)
    code, out, error = run(analyse, kind, path)
    assert code == 0, error
    assert f"serious: {finding}" in " ".join(out.split())


@pytest.mark.parametrize(
    ("kind", "figures"),
    [
        ("calibrate", lambda found: found["alpha"]),
        ("verify", lambda found: [one["rms_percent"] for one in found["points"]]),
    ],
)
def test_a_count_out_of_range_is_left_out_and_said(
    recorded: Recorded,
    sound: dict[str, Any],
    tmp_path: Path,
    kind: str,
    figures: Callable[[Any], list[float]],
) -> None:
    """One sample of millions ended the analysis."""
    change = CHANGES["encoder out of range at times"]
    path = change_recording(recorded.off, tmp_path / "run.mcap", change)
    found = json.loads(run(analyse, kind, path, "--json")[1])
    [finding] = [one for one in found["findings"] if one["name"].startswith("encoder")]
    assert (finding["name"], finding["severity"]) == ("encoder-out-of-range", "warning")
    assert figures(found) == pytest.approx(figures(sound[kind]), rel=1e-3)
    assert figures(found) != figures(sound[kind])


@pytest.mark.parametrize("kind", ["calibrate", "verify", "cogging"])
def test_a_torque_that_never_changes_is_refused(
    recorded: Recorded, tmp_path: Path, kind: str
) -> None:
    path = change_recording(recorded.off, tmp_path / "run.mcap", dead)
    code, _, error = run(analyse, kind, path)
    assert code == 1
    assert f"{path}: " in error
    assert "torque_Nm is 0.1 from the first sample to the last" in error


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (uncommanded, "phase b had a current, and none was commanded"),
        (CHANGES["currents * -1"], "phase a has the opposite sign of its command"),
    ],
)
def test_other_signs_and_no_command_are_refused(
    recorded: Recorded, tmp_path: Path, change: Change, reason: str
) -> None:
    path = change_recording(recorded.off, tmp_path / "run.mcap", change)
    code, _, error = run(analyse, "calibrate", path)
    assert code == 1
    assert reason in error


def test_another_unit_is_refused_by_how_much_it_is_off(recorded: Recorded, tmp_path: Path) -> None:
    path = change_recording(recorded.off, tmp_path / "run.mcap", CHANGES["currents in mA"])
    code, _, error = run(analyse, "calibrate", path)
    assert code == 1
    text = r"phase a is (\S+) times the commanded one \(RMS\): one of them is in another unit"
    [times] = re.findall(text, " ".join(error.split()))
    assert float(times) == pytest.approx(1000.0, rel=0.01)


@pytest.mark.parametrize("kind", ["calibrate", "verify"])
def test_sound_signals_have_no_such_finding(sound: dict[str, Any], kind: str) -> None:
    names = {one["name"] for one in sound[kind]["findings"]}
    assert not [name for name in names if "clipped" in name or "frozen" in name]
