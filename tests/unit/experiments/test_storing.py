"""`motord analyse --store`: every analysis once, with what it was made of."""

import json
import os
import shutil
from importlib.metadata import version
from pathlib import Path

import pytest

from motord.cli.analysis_command import app as analyse
from motord.config import load, packaged
from motord.config.experiments import analysis_kinds
from motord.recording.reader import open_run
from motord.results.result_json import read_result
from motord.results.store import ResultsStore
from motord.results.stored_result import file_digest
from tests.unit.experiments.conftest import Recorded
from tests.unit.experiments.test_cli import run
from tests.unit.results.buckets import SHOWN, URL, bucket, failing

pytestmark = pytest.mark.usefixtures("no_search_for_lines")


def stored(folder: Path) -> list[dict[str, object]]:
    contents = ResultsStore(folder).read()
    assert contents.unreadable == ()
    rows: list[dict[str, object]] = contents.table.to_pylist()
    return rows


def test_an_analysis_is_stored_once_with_what_it_is_of(recorded: Recorded, tmp_path: Path) -> None:
    store = tmp_path / "store"
    code, out, said = run(analyse, "verify", recorded.on, recorded.off, "--json", "--store", store)
    assert code == 0
    assert said.startswith(f"stored 44 figures in {store}/verify-")
    rows = stored(store)
    motor = load().motor
    common = {name: rows[0][name] for name in list(rows[0])[:8]}
    assert common == {
        "experiment": "verify", "motor": motor.name, "serial": motor.serial,
        "bench": load().bench.name, "run": "off.mcap, on.mcap", "time": rows[0]["time"],
        "version": version("motord"), "settings": "{}",
    }  # fmt: skip
    first_ns = int(open_run(recorded.off).ticks(("t_ns",))["t_ns"][0])
    assert rows[0]["time"].timestamp() * 1e9 == pytest.approx(first_ns, abs=1e3)
    values = {row["field"]: row["value"] for row in rows}
    errors = json.loads(out)["rms_error_percent"]
    assert values["rms_error_percent.after.mean"] == errors["after"]["mean"]
    code, _, said = run(analyse, "verify", recorded.off, recorded.on, "--store", store)
    assert code == 0
    assert said.startswith("duplicate result, nothing stored")
    assert stored(store) == rows


def test_a_name_that_is_no_text_is_stored_and_shown_as_the_terminal_does(
    recorded: Recorded, tmp_path: Path
) -> None:
    path, page = tmp_path / os.fsdecode(b"off\xff.mcap"), tmp_path / "page.html"
    path.hardlink_to(recorded.off)
    code, _, _ = run(analyse, "verify", path, "--report", page, "--store", tmp_path / "store")
    assert code == 0
    assert "off\\udcff.mcap" in page.read_text()
    assert {row["run"] for row in stored(tmp_path / "store")} == {"off\\udcff.mcap"}


@pytest.mark.parametrize("words", ["verify", "calibrate"])
def test_a_result_that_is_added_later_is_of_the_same_motor(
    words: str, recorded: Recorded, tmp_path: Path
) -> None:
    result = tmp_path / "result.json"
    code, _, said = run(analyse, words, recorded.off, "-o", result)
    assert code == 0, said
    kinds = {kind.schema: kind for kind in analysis_kinds().values() if kind.schema}
    added, config = read_result(result, kinds), load()
    assert (added.motor, added.serial) == (config.motor.name, config.motor.serial)


def test_settings_and_files_that_are_named_count_by_their_content(
    recorded: Recorded, tmp_path: Path
) -> None:
    store, bench = tmp_path / "store", tmp_path / "bench.toml"
    shutil.copy(packaged("sim.toml"), bench)
    shutil.copy(packaged("report.rig.toml"), tmp_path)
    copy = tmp_path / "copy.json"
    shutil.copy(recorded.calibration, copy)
    verify = ("verify", recorded.on, "--store", store)
    for arguments, new in (
        (("--calibration", recorded.calibration), True),
        (("--calibration", copy), False),
        (("-c", bench), True),
        (("-c", bench), False),
        ((), True),
    ):
        code, _, said = run(analyse, *verify, *arguments)
        assert (code, said.startswith("stored ")) == (0, new)
    settings = {str(row["settings"]) for row in stored(store)}
    digest = file_digest(recorded.calibration)
    assert '{"calibration":"sha256:' + digest + '"}' in settings
    assert len(settings) == 3
    bench.write_text(bench.read_text() + "\n# changed\n")
    assert run(analyse, *verify, "-c", bench)[2].startswith("stored ")


def test_a_table_that_the_bench_file_names_counts_too(recorded: Recorded, tmp_path: Path) -> None:
    motor = load().motor
    names = ("name", "serial", "pole_pairs", "slots", "counts", "rated_torque_Nm", "connection")
    lines = [f"{name} = {json.dumps(getattr(motor, name))}" for name in names]
    file = tmp_path / "motor.toml"
    file.write_text("\n".join(["[motor]", *lines, 'back_emf = "table.json"']) + "\n")
    verify = ("verify", recorded.on, "-c", file, "--store", tmp_path / "store")
    for scale, new in ((1.0, True), (1.0, False), (1.01, True)):
        table = {"k_V_s_per_rad": (scale * motor.back_emf_table()).tolist()}
        (tmp_path / "table.json").write_text(json.dumps(table))
        code, _, said = run(analyse, *verify)
        assert (code, said.startswith("stored ")) == (0, new)


def test_a_result_that_cannot_be_stored_is_printed_and_written(
    recorded: Recorded, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    output = tmp_path / "v.json"
    monkeypatch.setattr("motord.results.folders.folder.write_whole", full)
    arguments = ("verify", recorded.on, "-o", output, "--store", tmp_path / "store")
    code, out, said = run(analyse, *arguments)
    assert code == 1
    assert "after: mean" in out
    assert json.loads(output.read_text())["points"]
    assert said == (f"motord: {tmp_path}/store: cannot store the result: No space left on device\n")
    assert list((tmp_path / "store").iterdir()) == []


def test_a_result_whose_put_breaks_off_is_printed_and_written(
    recorded: Recorded, tmp_path: Path
) -> None:
    there = bucket(failing(ConnectionResetError("reset"), "put"), atomic=False)
    output = tmp_path / "v.json"
    code, out, said = run(analyse, "verify", recorded.on, "-o", output, "--store", URL)
    assert (code, said) == (1, f"motord: {SHOWN}: cannot store the result: reset\n")
    assert "after: mean" in out
    assert json.loads(output.read_text())["points"]
    assert there.objects == {}


def test_theory_without_recordings_is_not_stored(recorded: Recorded, tmp_path: Path) -> None:
    arguments = ("-c", packaged("sim.toml"), "--calibration", recorded.calibration)
    code, out, said = run(analyse, "sensitivity", *arguments, "--store", tmp_path / "store")
    assert code == 0
    assert "theory" in out
    assert said == "not stored: a store keeps results of recordings\n"
    assert not (tmp_path / "store").exists()


def test_nothing_is_analysed_for_a_store_that_cannot_be(
    recorded: Recorded, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr("motord.experiments.subject.Recordings.open", pytest.fail)
    code, out, said = run(analyse, "verify", recorded.on, "--store", tmp_path / "file" / "below")
    assert (code, out) == (1, "")
    assert "cannot store results there" in said
