"""What `motord analyse` says of recordings that are damaged, or given twice."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from motord.batch.task import BatchTask, analyse_recordings
from motord.cli import app
from motord.config import load
from motord.recording.reader import open_run
from motord.recording.recovery import recover
from tests.support.short_recordings import ShortRecording


@pytest.fixture(scope="module")
def recorded() -> ShortRecording:
    return ShortRecording.of(load(), turns=5)


@pytest.fixture
def whole(recorded, tmp_path) -> Path:
    return recorded.write(tmp_path / "whole.mcap")


@pytest.fixture
def cut(whole) -> Path:
    """A recording without its index and its last byte of messages."""
    chunk = open_run(whole).source.structure.chunks[-1]
    path = whole.with_name("cut.mcap")
    path.write_bytes(whole.read_bytes()[: chunk.offset + chunk.size + 9])
    return path


@pytest.fixture
def riddled(whole) -> Path:
    """A closed recording in which all chunks but the first and the last are damaged."""
    content = bytearray(whole.read_bytes())
    for chunk in open_run(whole).source.structure.chunks[1:-1]:
        content[chunk.offset + chunk.size // 2] ^= 0xFF
    path = whole.with_name("riddled.mcap")
    path.write_bytes(content)
    return path


def analyse(*arguments: object, code: int = 0):
    result = CliRunner().invoke(app, ["analyse", "cogging", *map(str, arguments)])
    assert result.exit_code == code, result.output
    return result


def test_of_a_whole_recording_nothing_is_missing(whole):
    result = analyse(whole, "--json")
    assert result.stderr == ""
    assert "damage" not in json.loads(result.stdout)


def test_a_recording_that_is_cut_is_analysed_and_said_to_be(cut, tmp_path):
    said = f"missing in {cut}: "
    [line] = analyse(cut).stderr.splitlines()
    assert line.startswith(said)
    result = analyse(cut, "--json", "-o", tmp_path / "o.json")
    assert result.stderr.startswith(said)
    for text in (result.stdout, (tmp_path / "o.json").read_text()):
        damage = json.loads(text)["damage"]
        assert list(damage) == [str(cut)]
        assert "cut off" in damage[str(cut)]


@pytest.mark.usefixtures("no_pictures")
def test_the_page_says_first_that_a_recording_is_cut(whole, cut, tmp_path):
    page = tmp_path / "page.html"
    analyse(cut, "--report", page)
    title, box, rest = page.read_text().partition('<div class="finding serious missing">')
    assert box
    assert title.endswith("</p>\n")  # beneath the title
    assert "The recording is damaged or cut: " in rest
    assert "cut.mcap: " in rest
    assert "cut off" in rest
    assert rest.index("cut off") < rest.index("<figure>")
    analyse(whole, "--report", page)
    assert "damaged or cut" not in page.read_text()


def test_an_error_says_first_that_the_recording_is_damaged(riddled):
    [line] = analyse(riddled, code=1).stderr.splitlines()
    assert line.startswith(f"motord: {riddled}: damaged, ")
    assert f"`motord record info --check {riddled}`" in line
    assert "says where): " in line


def test_each_of_many_is_said_to_be_damaged(whole, cut, riddled, monkeypatch):
    monkeypatch.setattr("motord.batch.task.missing_limits", lambda _: {})
    task = BatchTask("cogging", {}, {}, to_store=False)
    outcomes = analyse_recordings(task, [whole, cut, riddled]).results
    assert [one.missing.partition(":")[0] for one in outcomes] == ["", "missing", ""]
    assert outcomes[2].failure.startswith("damaged, ")


@pytest.mark.parametrize("again", ["whole.mcap", "link.mcap", "copy.mcap"])
def test_the_same_recording_twice_is_refused(whole, again, recorded, tmp_path):
    (tmp_path / "link.mcap").symlink_to(whole)
    shutil.copy(whole, tmp_path / "copy.mcap")
    other = recorded.write(tmp_path / "other.mcap", 1)
    line = analyse(whole, other, tmp_path / again, code=1).stderr
    assert f"{tmp_path / again}: is the same recording as {whole}; counted twice" in line


def test_a_recording_and_what_was_recovered_of_it_are_refused(cut, recorded, tmp_path):
    clean = recover(cut, tmp_path / "clean.mcap").path
    line = analyse(cut, clean, code=1).stderr
    assert f"{clean}: is the same recording as {cut}; counted twice" in line


@pytest.mark.parametrize("alike", [0, 50])
def test_two_recordings_may_begin_at_one_time_and_alike(whole, recorded, tmp_path, alike):
    """As of a simulated rig, or imported with one `start` and of a coarse sensor."""
    ticks, begin = recorded.ticks.copy(), recorded.points[0]["tick_start"]
    ticks["torque_Nm"][ticks["tick"] >= begin + alike] *= 1.001
    analyse(whole, replace(recorded, ticks=ticks).write(tmp_path / "other.mcap"))


def test_an_error_names_the_points_that_are_poor(recorded, tmp_path):
    points = tuple({**point, "quality": "the speed was 3 % off"} for point in recorded.points)
    path = replace(recorded, points=points).write(tmp_path / "poor.mcap")
    [line] = analyse(path, code=1).stderr.splitlines()
    assert "of its operating points is of good quality; left out as poor: " in line
    assert line.endswith("(the speed was 3 % off)")
