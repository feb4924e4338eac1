"""The files as their readers take them: moteus_tool, a C compiler, parsers."""

import asyncio
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from moteus import CommandError, moteus_tool

from motord.calibration.export import FORMATS, DriveFrame, exported
from motord.calibration.export.exported import Exported
from tests.unit.calibration_export.as_drives_read import linear
from tests.unit.calibration_export.cases import CONSTANT, calibration

HOSTILE = "a */ #error /* \nmotor.poles 2\r\n\\\n??/\n# x, y\n"
"""A motor's name that would end comments and begin lines."""


class Controller:
    """What moteus_tool talks to: takes the commands that a controller's console takes."""

    def __init__(self) -> None:
        self.values: dict[str, str] = {}
        self.stored: dict[str, str] = {}

    async def command(self, line: bytes) -> None:
        found = re.fullmatch(
            rb"conf set (motor\.cogging_dq_scale|motor\.cogging_dq_comp\.\d+) (\S+)", line
        )
        if found is None:
            raise CommandError(line)
        self.values[found[1].decode()] = found[2].decode()

    async def conf_write(self) -> None:
        self.stored = dict(self.values)


def make(name: str, motor: str = "axial", length: int | None = None) -> Exported:
    drive_format = FORMATS[name].resized(length, None)
    return exported(calibration(name=motor), drive_format, DriveFrame(0.5), CONSTANT)


@pytest.mark.parametrize("motor", ["axial", HOSTILE, "Maßmotor ⌀ 90"])
def test_moteus_tool_restores_the_table(
    motor: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = make("moteus", motor)
    path = tmp_path / "cogging.cfg"
    path.write_text(made.text(), encoding="utf-8")
    controller = Controller()
    asyncio.run(moteus_tool.Stream.do_restore_config(controller, str(path)))
    assert capsys.readouterr().out == ""  # it prints what could not be set
    table = made.columns[0].table
    assert len(controller.stored) == 1025
    assert float(controller.stored["motor.cogging_dq_scale"]) == pytest.approx(table.scale)
    sent = [int(controller.stored[f"motor.cogging_dq_comp.{i}"]) for i in range(1024)]
    assert sent == table.entries.tolist()
    assert max(map(abs, sent)) == 127


def test_moteus_tool_drops_the_table_for_firmware_that_has_none() -> None:
    """The names are the vendor's: its own downgrade to 0x0104 knows and removes them."""
    downgrade = Path(moteus_tool.__file__).read_text(encoding="utf-8")
    assert "x.startswith(b'motor.cogging_dq')" in downgrade
    assert all(
        line.startswith(("#", "motor.cogging_dq")) for line in make("moteus").text().splitlines()
    )


PROGRAM = """
#include <stdio.h>
#include "table.h"

int main(void)
{
    int i;
    printf("%s %d\\n", MOTORD_COMPENSATION_CALIBRATION, (int)sizeof motord_compensation_torque);
    for (i = 0; i < MOTORD_COMPENSATION_SIZE; i++)
        printf("%.9g %.9g\\n",
               (double)(MOTORD_COMPENSATION_TORQUE_SCALE_NM * motord_compensation_torque[i]),
               (double)(MOTORD_COMPENSATION_CURRENT_SCALE_A * motord_compensation_current[i]));
    return 0;
}
"""


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")
@pytest.mark.parametrize(
    ("motor", "bits", "length"), [("axial", None, None), (HOSTILE, 8, 77), ("Maß", 12, 4)]
)
def test_the_header_compiles_and_has_the_values(
    motor: str, bits: int | None, length: int | None, tmp_path: Path
) -> None:
    drive_format = FORMATS["c-header"].resized(length, bits)
    made = exported(calibration(name=motor), drive_format, DriveFrame(), CONSTANT)
    (tmp_path / "table.h").write_text(made.text(), encoding="utf-8")
    (tmp_path / "main.c").write_text('#include "table.h"\n' + PROGRAM, encoding="utf-8")
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    command = ["gcc", *flags, "main.c", "-o", "main"]
    compiled = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert compiled.returncode == 0, compiled.stderr
    out = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True).stdout
    first, *rows = out.splitlines()
    torque, current = (one.table for one in made.columns)
    assert first == f"{made.calibration.id} {torque.entries.nbytes}"
    values = np.array([[float(each) for each in row.split()] for row in rows])
    assert values[:, 0] == pytest.approx(torque.values, rel=1e-5)
    assert values[:, 1] == pytest.approx(current.values, rel=1e-5)


@pytest.mark.parametrize("name", FORMATS)
def test_a_name_does_not_break_out_of_the_comments(name: str) -> None:
    """What is no comment is the same, but for the calibration's id and name."""
    own, hostile = make(name, "axial"), make(name, HOSTILE)
    if name == "odrive":
        assert (
            json.loads(hostile.text())["cogging_map_Nm"]
            == (json.loads(own.text())["cogging_map_Nm"])
        )
        return
    texts = [re.sub(r"/\*.*?\*/", "", each.text(), flags=re.DOTALL) for each in (own, hostile)]
    if name != "c-header":
        texts = [re.sub(r"^#.*\n", "", text, flags=re.MULTILINE) for text in texts]
    assert texts[1].replace(hostile.calibration.id, own.calibration.id) == texts[0]


@pytest.mark.parametrize("name", FORMATS)
def test_every_file_names_calibration_unit_residual_and_what_is_not_compensated(name: str) -> None:
    made = make(name)
    text = made.text()
    for line in made.lines():
        assert line in text or json.dumps(line)[1:-1] in text
    words = "\n".join(made.lines())
    assert made.calibration.id in words
    assert made.columns[0].left.to_text() in words
    assert "not compensated: gains of the phases 0.8, 1.118, 1.118" in words
    assert "not compensated: offsets of the phases 1, -0.4, -0.6 A" in words
    assert "drive angle = 28.6479 deg + forwards angle of the bench" in words


def test_the_odrive_map_says_nothing_but_numbers() -> None:
    content = json.loads(make("odrive").text())
    assert np.array(content["cogging_map_Nm"], np.float32).tolist() == (
        make("odrive").columns[0].table.entries.tolist()
    )
    assert content["residual"]["torque"] == make("odrive").columns[0].left.content()


def test_the_vendors_interpolation_wraps() -> None:
    """The reader of the tests at both ends of the turn: as in the firmware's source."""
    assert linear([1.0, 3.0], 0.75) == 2.0
    assert linear([1.0, 3.0], 0.0) == 1.0
