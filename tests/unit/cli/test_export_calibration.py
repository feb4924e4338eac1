"""`motord calibration export`: files, figures and refusals."""

import json
import math
from pathlib import Path
from typing import Any, get_args

import pytest
from typer.testing import CliRunner

from motord.calibration import CalibratedMotor, Calibration
from motord.calibration.export import FORMATS
from motord.cli import app
from motord.cli.calibration.export import Format
from motord.config import load, packaged
from tests.contract.peers import until
from tests.support.calibrations import put_in_force
from tests.unit.calibration_export.cases import calibration
from tests.unit.service.live_service import live_service

SIM = packaged("sim.toml")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "calibration.json"
    calibration().save(path)
    return path


def export(*arguments: object) -> tuple[int, str, str]:
    words = ["calibration", "export", *map(str, arguments)]
    result = CliRunner().invoke(app, words)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr


def test_the_names_are_those_of_the_registry() -> None:
    assert get_args(Format) == tuple(FORMATS)
    assert all(name == one.name for name, one in FORMATS.items())
    shown = CliRunner().invoke(app, ["calibration", "export", "--help"]).stdout
    assert "|".join(FORMATS) in "".join(shown.split())


@pytest.mark.parametrize("name", FORMATS)
def test_each_format_is_written_and_says_what_it_leaves(
    name: str, file: Path, tmp_path: Path
) -> None:
    output = tmp_path / "out"
    code, out, err = export(
        "--format", name, file, "--torque-constant", 0.3, "-o", output, "--zero", 30, "--backwards"
    )
    assert (code, out) == (0, f"{output}\n")
    assert "left of it by" in err
    assert "drive angle = 30 deg - forwards angle of the bench" in err
    assert "not compensated: gains" in err
    printed = export(
        "--format", name, file, "--torque-constant", 0.3, "--zero", 30, "--backwards"
    )  # fmt: skip
    assert printed[1] == output.read_text(encoding="utf-8")
    assert printed[2] == err


def test_json_has_the_figures_and_the_content_unless_it_is_in_a_file(
    file: Path, tmp_path: Path
) -> None:
    arguments = ("--format", "moteus", file, "--torque-constant", 0.3, "--json")
    code, out, err = export(*arguments)
    content = json.loads(out)
    assert (code, err) == (0, "")
    assert content["residual"]["current"]["rms_percent"] < 0.05
    assert content["residual"]["current"].keys() == {
        "rms_Nm", "rms_percent", "worst_Nm", "worst_percent"
    }  # fmt: skip
    assert content["content"].count("motor.cogging_dq_comp.") == 1024
    written = json.loads(export(*arguments, "-o", tmp_path / "m")[1])
    assert written["file"] == str(tmp_path / "m")
    assert "content" not in written


def of_bench(**changes: object) -> Calibration:
    """A calibration of the packaged bench's motor."""
    motor = CalibratedMotor.of(load().motor)
    return calibration(counts=motor.counts, motor=motor, **changes)


def test_the_benchs_back_emf_makes_amperes_with_the_common_gain(tmp_path: Path) -> None:
    one, other = tmp_path / "one.json", tmp_path / "other.json"
    of_bench().save(one)
    of_bench(delta_epsilon=0.8).save(other)
    tables = []
    for path in (one, other):
        code, out, err = export("--format", "csv", path, "-c", SIM)
        assert code == 0, err
        rows = [line.split(",") for line in out.splitlines() if line[0] not in "#a"]
        tables.append([float(row[2]) / float(row[1]) for row in rows if abs(float(row[1])) > 0.1])
    assert tables[0][0] == pytest.approx(0.8 * tables[1][0], rel=1e-3)


def test_a_bench_with_another_motor_is_refused(file: Path) -> None:
    code, _, err = export("--format", "moteus", file, "-c", SIM)
    assert code == 1
    assert "was made for another motor" in err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--format", "moteus"), "moteus is in amperes: give the bench file, -c FILE, or"),
        (("--format", "moteus", "--length", 512), "--length and --bits are not for moteus: it is"),
        (("--format", "odrive", "--bits", 8), "--length and --bits are not for odrive"),
        (("--format", "csv", "--bits", 8), "--bits is not for csv: its values are decimals"),
        (("--format", "csv", "-c", "no.toml"), "no.toml: cannot read it"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(
    arguments: tuple[object, ...], says: str, file: Path
) -> None:
    code, out, err = export(*arguments, file)
    assert (code, out) == (1, "")
    assert says in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("given", [("--format", "vesc"), ()])
def test_no_or_an_unknown_format_is_wrong_usage_that_names_those_known(
    given: tuple[str, ...], file: Path
) -> None:
    code, _, err = export(*given, file)
    assert code == 2
    assert "--format" in err
    assert all(name in err for name in FORMATS)


@pytest.mark.parametrize(
    ("zero", "within"), [(750, 30), (-690, -330), (1e308, math.fmod(1e308, 360))]
)
def test_a_zero_beyond_a_turn_is_that_within_it(zero: float, within: float, file: Path) -> None:
    arguments = "--format", "odrive", file, "--zero"
    assert export(*arguments, zero) == export(*arguments, within)


@pytest.mark.parametrize("option", ["--zero", "--torque-constant"])
@pytest.mark.parametrize("value", ["nan", "inf"])
def test_what_is_no_number_is_wrong_usage(option: str, value: str, file: Path) -> None:
    code, _, err = export("--format", "odrive", file, option, value)
    assert code == 2
    assert "have to be finite" in err or "greater than or equal" in err


def in_force(service: Any) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(service.publisher.documents["state"]())["calibration"]
    return content


def test_without_a_file_it_is_the_calibration_in_force(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with live_service(tmp_path) as service:
        code, _, err = export("--format", "odrive", "--connect", service.listen)
        assert code == 1
        assert "no calibration is in force; name a file, or install one" in err
        service.store.current = of_bench()
        until(lambda: in_force(service))
        code, _, err = export("--format", "odrive", "--connect", service.listen)
        assert (code, "is in force, but not written to a file yet: try again" in err) == (1, True)
        put_in_force(service.store, of_bench())
        until(lambda: in_force(service)["path"])
        code, out, err = export("--format", "odrive", "--connect", service.listen)
    assert code == 0, err
    assert json.loads(out)["calibration"] == of_bench().id


def test_a_calibration_without_cogging_or_no_calibration_is_refused(tmp_path: Path) -> None:
    none, other = tmp_path / "none.json", tmp_path / "other.json"
    calibration(harmonics=()).save(none)
    other.write_text('{"a": 1}')
    code, _, err = export("--format", "odrive", none)
    assert code == 1
    assert "has no cogging torque: there is nothing to export" in err
    code, _, err = export("--format", "odrive", other)
    assert code == 1
    assert f"{other}: not a calibration file: it names no schema" in err


def test_a_file_is_only_written_over_with_force(file: Path, tmp_path: Path) -> None:
    output = tmp_path / "map.json"
    output.write_text("mine")
    code, _, err = export("--format", "odrive", file, "-o", output)
    assert code == 1
    assert f"{output}: is there already" in err
    assert output.read_text() == "mine"
    assert export("--format", "odrive", file, "-o", output, "--force")[0] == 0
    assert len(json.loads(output.read_text())["cogging_map_Nm"]) == 3600


def test_a_folder_that_is_not_there_is_said(file: Path, tmp_path: Path) -> None:
    code, _, err = export("--format", "odrive", file, "-o", tmp_path / "no" / "map.json")
    assert code == 1
    assert f"map.json: there is no folder {tmp_path}/no; make it" in err
    assert list(tmp_path.iterdir()) == [file]
