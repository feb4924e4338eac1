"""What recordings are of: their motor's serial number."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from motord.config import packaged
from motord.experiments.subject import Recordings


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
