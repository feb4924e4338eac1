"""What recordings are of: their motor's serial number, the settings of their plan."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from motord.config import packaged
from motord.experiments.friction import FrictionConfig
from motord.experiments.subject import (
    AnalysisError,
    Recordings,
    plan_settings,
    recorded_settings,
)


@pytest.mark.parametrize(
    ("recorded", "serial"),
    [(["A", "A"], "A"), (["", "A"], "A"), ([""], ""), (["A", "B"], ""), ([], "")],
)
def test_a_file_without_a_serial_number_has_the_one_that_recordings_name(
    recorded: list[str], serial: str, tmp_path: Path
) -> None:
    """Also where some of them name none, as without the file."""
    bench, text = tmp_path / "bench.toml", packaged("sim.toml").read_text()
    bench.write_text(
        text.replace('rig = "report.rig.toml"\n', "").replace('serial = "sim-1"\n', "")
    )
    runs = tuple(SimpleNamespace(motor_metadata={"serial": one}) for one in recorded)
    assert Recordings(cast("Any", runs), bench).subject.motor.serial == serial


def test_settings_that_cannot_be_read_are_to_be_named_where_that_helps() -> None:
    run = SimpleNamespace(path="a.mcap", plan_metadata={"settings": {"repeats": -1}})
    with pytest.raises(AnalysisError, match=r"^a.mcap: this version .* settings of its plan$"):
        recorded_settings(cast("Any", run), FrictionConfig)
    with pytest.raises(AnalysisError, match=r"of its plan; name a bench file with -c$"):
        plan_settings(Recordings(cast("Any", (run,))), "friction", FrictionConfig)
