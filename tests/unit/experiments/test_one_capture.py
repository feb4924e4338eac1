"""One capture whose turns cannot be counted: every analysis of many goes on and says so."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.experiments.captures_left_out import CapturesLeftOut, prepared
from motord.identification import IdentifyError
from motord.identification.operating_points import REQUIRED, split
from motord.recording.reader import open_run
from tests.support.wrong_signals import change_recording
from tests.unit.experiments.conftest import Recorded


def without_a_turn(path: Path, target: Path) -> Path:
    """Write the recording without the middle turn of its second point."""

    def changed(ticks: np.ndarray) -> np.ndarray:
        [own] = np.nonzero(ticks["plan_point"] == 1)
        turn = round(1 / abs(float(np.median(ticks["speed_rad_s"][own]))) * 2 * np.pi * 1000)
        middle = own[own.size // 2]
        return np.delete(ticks, np.arange(middle, middle + turn))

    return change_recording(path, target, changed)


@pytest.mark.usefixtures("no_search_for_lines", "no_pictures")
@pytest.mark.parametrize("command", ["verify", "calibrate"])
def test_a_point_with_lost_turns_is_left_out_and_said(
    command: str, recorded: Recorded, tmp_path: Path
) -> None:
    """Its speed and its noise were of turns that nobody counted; an error ended all the others."""
    path = without_a_turn(recorded.off, tmp_path / "gap.mcap")
    points = len(open_run(path).operating_points())
    page, result = tmp_path / "page.html", tmp_path / "result.json"
    arguments = ["analyse", command, path, "-o", result, "--report", page]
    done = CliRunner().invoke(app, [str(one) for one in arguments])
    assert done.exit_code == 0, done.output
    found = json.loads(result.read_text())
    [left_out] = [one for one in found["findings"] if one["name"] == "points-left-out"]
    assert "gap.mcap: " in left_out["meaning"]
    assert "turns: they cannot be counted" in left_out["meaning"]
    assert "they cannot be counted" in page.read_text()
    if command == "verify":
        assert len(found["points"]) == points - 1


def test_a_capture_that_is_left_out_is_named_once() -> None:
    """Errors name it with its recording or without: "2 Nm, 5 Hz: 2 Nm, 5 Hz: no currents"."""
    label, left_out = "run.mcap: 2 Nm, 5 Hz", CapturesLeftOut()
    for named in ("", "2 Nm, 5 Hz: ", f"{label}: "):
        with left_out.noted(label, 0):
            raise IdentifyError(f"{named}no currents")
    assert left_out.reasons == (f"{label}: no currents",)


def test_captures_that_are_alike_count_each_and_once() -> None:
    """As with induced errors, or without and with compensation: two seemed one."""
    ticks = np.zeros(300, [(name, np.int64) for name in ("tick", "plan_point", *REQUIRED)])
    ticks["tick"] = np.arange(300)
    ticks["t_ns"] = 10**6 * ticks["tick"]
    ticks["plan_point"] = ticks["tick"] // 150
    points = [
        {
            "index": n,
            "tick_start": 150 * n,
            "tick_end": 150 * n + 149,
            "torque_Nm": 2,
            "speed_Hz": 5,
        }
        for n in range(2)
    ]
    left_out = CapturesLeftOut()
    for _ in range(2):  # as where recordings are read again
        assert not list(prepared(split(ticks, points, "run.mcap"), 4096, left_out))
    ticks["t_ns"] += 10**12  # another recording of the same name, in another folder
    assert not list(prepared(split(ticks, points, "run.mcap"), 4096, left_out))
    [finding] = left_out.findings()
    assert finding.value == 4
    assert "(run.mcap: 2 Nm, 5 Hz: no whole turn" in finding.meaning
    assert finding.meaning.endswith("(4 times)")
