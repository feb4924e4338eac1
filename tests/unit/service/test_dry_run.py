"""The second part of a dry run: what the client machine needs to try a plan out."""

from types import SimpleNamespace

import pytest
import typer

from motord.api.replies import ConfigReply
from motord.cli.plan.preflight import forecast_text, predict, warning
from motord.config import load
from tests.support.calibrations import calibration

SHORT = {"torques_Nm": [2.0], "speeds_Hz": [1.0], "turns": 2}
NO_TIME_S = 1e-9


class Client:
    """A daemon with a bench and, perhaps, a calibration in force."""

    def __init__(self, path=None, **bench):
        self.bench_file = load().model_dump(mode="json")
        self.bench_file["bench"].update(bench)
        self.view = SimpleNamespace(path=str(path)) if path else None

    def config(self):
        return ConfigReply(toml="", config=self.bench_file)

    def state(self):
        return SimpleNamespace(calibration=self.view)


def complaint(capsys, *arguments):
    with pytest.raises(typer.Exit):
        predict(*arguments)
    return capsys.readouterr().err


def test_a_plan_that_compensates_is_tried_out_with_the_calibration_in_force(tmp_path):
    path = tmp_path / "calibration.json"
    calibration().save(path)
    [each] = predict(Client(path), "verify", SHORT, NO_TIME_S)
    assert (each.simulated, each.trouble) == (False, "")
    assert forecast_text(each) == "not simulated: no time left"
    assert warning([each], "verify") == "1 were not simulated: give it more time by --limit-s"


def test_a_calibration_that_is_elsewhere_is_reported(tmp_path, capsys):
    said = complaint(capsys, Client(tmp_path / "none.json"), "verify", SHORT, NO_TIME_S)
    assert said.startswith("motord: not simulated: ")
    assert "run this on the daemon's machine, or with --limit-s 0" in said
    assert "no calibration is installed any more" in complaint(
        capsys, Client(), "verify", SHORT, NO_TIME_S
    )


def test_a_rig_file_that_is_elsewhere_is_reported(tmp_path, capsys):
    client = Client(rig=str(tmp_path / "none.toml"))
    said = complaint(capsys, client, "calibrate", SHORT, 60.0)
    assert "not simulated" in said
    assert "none.toml" in said
