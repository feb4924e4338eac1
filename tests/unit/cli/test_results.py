"""`motord results`: what is asked, charted, compared and added, as text, CSV, JSON and pictures."""

import csv
import io
import json
import os
import shlex
import xml.etree.ElementTree as ET
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from motord.cli import app
from motord.cli.results.printing import aligned, as_csv, as_objects
from motord.recording.writer import RunWriter
from motord.results.store import ResultsStore
from motord.untrusted import SIZE_MAX
from tests.support.calibrations import calibration
from tests.unit.results.buckets import SHOWN, URL, bucket, failing
from tests.unit.results.made_up import figure, fill, result

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MOTORD_STORE", "store")
    return tmp_path


def motord(words, code=0):
    done = CliRunner().invoke(app, shlex.split(words))
    assert isinstance(done.exception, SystemExit | None), repr(done.exception)
    assert done.exit_code == code, done.output
    return done


def test_a_question_as_text_csv_and_json(folder):
    fill(folder / "store", [0.8, 0.1 + 0.2])
    asked = "results query 'SELECT run, time, value, stderr FROM results ORDER BY run'"
    assert motord(asked).stdout.splitlines() == [
        "run           time                  value  stderr",
        "------------  --------------------  -----  ------",
        "run-000.mcap  2026-03-01T08:00:00Z    0.8   0.001",
        "run-001.mcap  2026-03-02T08:00:00Z    0.3   0.001",
    ]
    assert motord(f"{asked} --csv").stdout.splitlines() == [
        "run,time,value,stderr",
        "run-000.mcap,2026-03-01T08:00:00Z,0.8,0.001",
        "run-001.mcap,2026-03-02T08:00:00Z,0.30000000000000004,0.001",
    ]
    rows = json.loads(motord(f"{asked} --json").stdout)
    assert rows[1] == {
        "run": "run-001.mcap", "time": "2026-03-02T08:00:00Z",
        "value": 0.30000000000000004, "stderr": 0.001,
    }  # fmt: skip


def test_an_error_in_the_sql_is_one_line(folder):
    fill(folder / "store", 0.8)
    done = motord("results query 'SELECT nofield FROM results'", 1)
    assert done.stdout == ""
    [line] = done.stderr.splitlines()
    assert line.startswith("motord: SQL: Binder Error: ")


def test_an_empty_store_is_answered_and_named(folder):
    fill(folder / "store", [])
    done = motord("results query 'SELECT count(*) AS n FROM results' --csv")
    assert (done.stdout, done.stderr) == ("n\n0\n", "store: the store is empty\n")
    for words in ("results trend alpha.a", "results compare A B"):
        assert motord(words, 1).stderr == "motord: the store is empty\n"


def test_what_cannot_be_read_is_named_after_the_rest(folder):
    fill(folder / "store", [0.8, 0.9])
    (folder / "store" / "a.parquet").write_text("none")
    (folder / "store" / "b.parquet").write_text("none")
    for words in (
        "query 'SELECT count(*) FROM results'", "trend alpha.a", "compare run-000.mcap run-001.mcap"
    ):  # fmt: skip
        done = motord(f"results {words}", 1)
        assert done.stdout
        first, second = done.stderr.splitlines()
        assert first.startswith("motord: store/a.parquet: no Parquet file")
        assert second.startswith("motord: store/b.parquet: no Parquet file")


def test_a_trend_names_the_points_that_violate_rules(folder):
    noise = np.random.default_rng(2).normal(0.8, 0.001, 25)
    noise[10] += 0.02
    fill(folder / "store", noise)
    fill(folder / "store", 0.7, serial="B")
    text = motord("results trend alpha.a").stdout
    assert "serial A-1: 25 results, mean 0.80" in text
    assert "run-010.mcap" in text
    assert "rule 1: a point beyond 3 sigma" in text
    assert "serial B: one result, 0.7: no limits" in text
    assert "preliminary" not in text
    one, other = json.loads(motord("results trend alpha.a --json").stdout)
    assert one["serial"] == "A-1"
    assert [1 in point["violated"] for point in one["points"]].index(True) == 10
    assert one["limits"][0] < one["mean"] < one["limits"][1]
    assert (other["mean"], other["limits"], other["points"][0]["value"]) == (None, None, 0.7)
    [bench] = json.loads(motord("results trend alpha.a --by bench --json").stdout)
    assert (bench["bench"], len(bench["points"])) == ("north", 26)


def test_a_trend_of_results_that_wander_says_so(folder):
    fill(folder / "store", 0.8 + 0.01 * np.sin(np.arange(30) / 4))
    text = motord("results trend alpha.a").stdout
    assert "results resemble those before: correlation 0.9" in text
    [one] = json.loads(motord("results trend alpha.a --json").stdout)
    assert one["correlated"]


def test_few_results_have_preliminary_limits_and_units_are_shown(folder):
    store = fill(folder / "store", [])
    for number, value in enumerate((1.0, 2.0, 1.5)):
        store.add(result(number, figures=[figure(value, "beta_A.a", "A", None)]))
    text = motord("results trend beta_A.a").stdout
    assert "mean 1.5 A, sigma" in text
    assert "stated standard error none" in text
    assert "the limits are preliminary" in text
    assert "no rule is violated" in text


@pytest.mark.parametrize("name", ["chart.svg", "chart.png"])
def test_a_trend_is_drawn(folder, name):
    fill(folder / "store", [0.8, 0.81, 0.79, 0.95])
    fill(folder / "store", 0.7, serial="B & <C>")
    assert motord(f"results trend alpha.a -o {name}").stdout.endswith(f"wrote {name}\n")
    content = (folder / name).read_bytes()
    if name.endswith("png"):
        assert content.startswith(PNG)
    else:
        assert ET.fromstring(content).tag == "{http://www.w3.org/2000/svg}svg"


def test_a_picture_shows_points_intervals_limits_and_rules():
    from motord.report.plots.control_charts import ChartPanel, control_charts

    panel = ChartPanel(
        "serial A", np.array([1.0, 2.0, 9.0]), np.array([[0.5, np.nan, 0.5], [1.0, np.nan, 1.0]]),
        ["2026-03-01"] * 3, (0.0, 3.0, 6.0), [(), (), (1, 2)],
    )  # fmt: skip
    [axes] = control_charts("alpha.a", [panel]).axes
    texts = [one.get_text() for one in axes.texts]
    assert texts == ["-3σ", "mean", "+3σ", "1,2"]
    assert [one.xy[1] for one in axes.texts] == [0.0, 3.0, 6.0, 10.0]
    heights = {line.get_ydata()[0] for line in axes.lines if len(set(line.get_ydata())) == 1}
    assert {0.0, 3.0, 6.0} <= heights
    [bars] = axes.containers
    ends = [segment[:, 1].tolist() for segment in bars.lines[2][0].get_segments()]
    assert ends == [[0.5, 2.0], [2.0, 2.0], [8.5, 10.0]]
    assert axes.get_title(loc="left") == "alpha.a, serial A"


def test_too_many_charts_are_none(folder):
    store = fill(folder / "store", [])
    for number in range(25):
        store.add(result(number, serial=f"S{number}"))
    done = motord("results trend alpha.a -o chart.svg", 1)
    assert "25 charts, at most 24 on a picture" in done.stderr
    assert not (folder / "chart.svg").exists()


def test_nothing_is_compared_with_itself(folder):
    assert "are the same" in motord("results compare A-1 A-1", 2).output


def test_two_motors_are_compared(folder):
    store = fill(folder / "store", 0.8)
    figures = [figure(0.81), figure(1.0, "condition_number", "", None)]
    store.add(result(1, serial="B", figures=figures))
    store.add(result(2, figures=[figure(30.0, "condition_number", "", None)]))
    lines = motord("results compare A-1 B").stdout.splitlines()
    assert "alpha.a" in lines[2]
    assert lines[2].endswith("changed")
    assert lines[3] == (
        "1 of 1 differences are more than the uncertainties explain (5 % for all of them "
        "together); 1 figures state no uncertainty"
    )
    assert "condition_number" in motord("results compare A-1 B --all").stdout
    found = json.loads(motord("results compare A-1 B --json").stdout)
    assert (found["compared"], found["a"], found["b"]) == ("serial", "A-1", "B")
    assert found["differences"][0]["difference"] == pytest.approx(0.01)
    assert found["differences"][1]["p_value"] is None


def test_differences_have_two_digits_of_their_uncertainty(folder):
    store = fill(folder / "store", 0.800123456)
    store.add(result(1, serial="B", figures=[figure(0.812345678)]))
    cells = motord("results compare A-1 B").stdout.splitlines()[2].split()
    assert cells[2:6] == ["0.8001", "0.8123", "0.0122", "0.0028"]
    assert len(cells[6].replace("0.", "").lstrip("0").split("e")[0].replace(".", "")) <= 3
    found = json.loads(motord("results compare A-1 B --json").stdout)
    assert found["differences"][0]["a"]["value"] == 0.800123456


def test_a_difference_that_rounds_to_nothing_is_no_negative_zero(folder):
    store = fill(folder / "store", 0.8000004)
    store.add(result(1, serial="B", figures=[figure(0.8)]))
    cells = motord("results compare A-1 B").stdout.splitlines()[2].split()
    assert cells[2:5] == ["0.8", "0.8", "0"]


def test_means_of_several_results_say_what_is_taken_as_common(folder):
    """Two of a side, which agree, differ by 2.5 of the uncertainties that they would average to."""
    store = fill(folder / "store", [0.8, 0.8])
    for number in (2, 3):
        store.add(result(number, serial="B", figures=[figure(0.8025)]))
    text = motord("results compare A-1 B").stdout
    assert "counts as common to a side and is not divided by their number" in " ".join(text.split())
    assert "0 of 1 differences" in text


def test_two_versions_of_the_same_recordings_share_their_noise(folder):
    store = fill(folder / "store", 0.8)
    store.add(result(0, (0.8001,), version="1.1"))
    text = motord("results compare 1.0 1.1").stdout
    assert "0 of 1 differences" in text
    assert "same recordings, whose noise they share" in text
    store.add(result(5, version="1.2"))
    assert "whose noise" not in motord("results compare 1.0 1.2").stdout
    fill(folder / "store", 0.8, serial="B")
    assert "whose noise" not in motord("results compare A-1 B").stdout


def test_without_common_figures_nothing_is_compared(folder):
    store = fill(folder / "store", 0.8)
    store.add(result(1, serial="B", experiment="verify"))
    assert "no figures in common" in motord("results compare A-1 B", 1).stderr


def test_a_calibration_that_exists_is_added_once(folder):
    made = calibration()
    made.save(folder / "c.json")
    assert "stored 8 figures in store/calibrate-" in motord("results add c.json").stdout
    assert "duplicate result, nothing stored" in motord("results add c.json").stdout
    [row] = ResultsStore(folder / "store").read().table.slice(0, 1).to_pylist()
    assert (row["experiment"], row["motor"], row["serial"]) == (
        "calibrate", made.motor.name, made.motor.serial,
    )  # fmt: skip
    assert (row["time"], row["version"]) == (made.created, "")


def test_a_time_that_no_other_zone_has_is_taken_from_the_file(folder):
    last = datetime.max.replace(tzinfo=timezone(timedelta(hours=-1)))
    made = calibration()
    made.model_copy(update={"id": "", "created": last}).save(folder / "c.json")
    os.utime(folder / "c.json", (1e9, 1e9))
    assert "stored 8 figures in store/calibrate-" in motord("results add c.json").stdout
    [row] = ResultsStore(folder / "store").read().table.slice(0, 1).to_pylist()
    assert row["time"] == datetime.fromtimestamp(1e9, UTC)


def test_a_store_at_a_url_is_added_to_and_asked(folder, monkeypatch):
    there = bucket()
    monkeypatch.setenv("MOTORD_STORE", URL)
    calibration().save(folder / "c.json")
    assert f"stored 8 figures in {SHOWN}/calibrate-" in motord("results add c.json").stdout
    assert "duplicate result, nothing stored" in motord("results add c.json").stdout
    assert len(there.objects) == 1
    fill(URL, [0.8, 0.9])
    fill(URL, 0.7, serial="B")
    counted = motord("results query 'SELECT count(*) AS n FROM results' --csv").stdout
    assert counted == "n\n11\n"
    assert "serial A-1: 2 results" in motord("results trend alpha.a").stdout
    assert "alpha.a" in motord("results compare A-1 B").stdout
    there.objects["motors/line 1/bad.parquet"] = b"half"
    done = motord("results query 'SELECT 1 AS a'", 1)
    assert done.stderr.startswith(f"motord: {SHOWN}/bad.parquet: no Parquet file")
    there.fault = staticmethod(failing(PermissionError("Access Denied"), "ls", "put"))
    for words in ("results query 'SELECT 1'", "results add c.json", "results trend alpha.a"):
        [line] = motord(words, 1).stderr.splitlines()
        assert line.startswith(f"motord: {SHOWN}: cannot ")
        assert line.endswith("Access Denied")


def test_files_that_are_no_results_are_named_and_the_rest_is_added(folder):
    calibration().save(folder / "c.json")
    (folder / "other.json").write_text('{"schema": "motord.other/1"}')
    (folder / "half.json").write_text('{"schema": "motord.cogging/1", "peak_Nm": 0.')
    (folder / "odd.json").write_text('{"schema": "motord.cogging/1", "peak_Nm": 1, "x": "\\ud800"}')
    (folder / "deep.json").write_text("[" * 100_000)
    (folder / "nothing.json").write_text('{"schema": "motord.cogging/1", "peak_Nm": NaN}')
    bad = ["other.json", "half.json", "odd.json", "deep.json", "nothing.json", "none.json"]
    done = motord(f"results add c.json {' '.join(bad)} --json", 1)
    assert len(json.loads(done.stdout)) == 1
    lines = done.stderr.splitlines()
    assert len(lines) == len(bad)
    for name, line in zip(bad, lines, strict=True):
        assert line.startswith(f"motord: {name}: ")
    assert len(list((folder / "store").iterdir())) == 1


def test_csv_has_no_formula_from_names():
    assert as_csv(("a", "=b"), [("@x", -1.0)]) == "a,'=b\n'@x,-1.0"


CELLS = st.none() | st.floats() | st.integers() | st.text(max_size=5) | st.booleans()


@given(st.lists(st.tuples(CELLS, CELLS), max_size=5))
def test_whatever_the_values_lines_are_lines_and_csv_and_json_are_read_back(rows):
    lines = list(aligned(("a", "b"), rows))
    assert len(lines) == 2 + len(rows)
    assert not any(set(line) & set("\n\r\x1b") for line in lines)
    read = list(csv.reader(io.StringIO(as_csv(("a", "b"), rows), newline="")))
    assert read[0] == ["a", "b"]
    assert len(read) == 1 + len(rows)
    assert len(json.loads(json.dumps(as_objects(("a", "b"), rows), allow_nan=False))) == len(rows)


def test_what_is_no_result_is_named_and_how_a_recording_becomes_one(folder):
    RunWriter(folder / "a.mcap", {}).close({})
    (folder / "large.mcap").write_bytes((folder / "a.mcap").read_bytes())
    os.truncate(folder / "large.mcap", SIZE_MAX + 1)
    (folder / "a.bin").write_bytes(b"\xff\xfe")
    said = motord("results add a.mcap large.mcap a.bin", code=1).stderr.splitlines()
    made = "a recording, no result: motord analyse KIND {} --store DIR makes the result and adds it"
    assert said[:2] == [f"motord: {name}: {made.format(name)}" for name in ("a.mcap", "large.mcap")]
    assert said[2].startswith("motord: a.bin: no result of an analysis: no text: ")
