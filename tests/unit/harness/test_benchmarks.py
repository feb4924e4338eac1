"""The runner of the benchmarks: finds them, compares with bounds, survives one that fails."""

import json
import math
from pathlib import Path

import pytest

from tests.benchmarks import run
from tests.benchmarks.figure import Figure


@pytest.mark.parametrize(
    ("value", "bound", "side", "met", "expected"),
    [
        (0.04, 0.05, "at most", True, "met"),
        (0.06, 0.05, "at most", False, "NOT MET"),
        (6.0, 5.0, "at least", True, "met"),
        (4.0, 5.0, "at least", False, "NOT MET"),
        (4.0, None, "at most", None, ""),
        (math.nan, 5.0, "at most", None, "not measured"),
        (4.0, math.nan, "at most", None, "not measured"),
    ],
)
def test_a_figure_and_its_bound(
    value: float, bound: float | None, side: str, met: bool | None, expected: str
) -> None:
    figure = Figure("x", value, "us", bound, side)
    assert figure.met is met
    assert figure.row()[3] == expected
    assert json.loads(json.dumps(figure.as_json(), allow_nan=False))["met"] is met


@pytest.mark.parametrize(
    ("value", "text"), [(0.03141, "0.0314"), (3.0, "3"), (1234.6, "1235"), (math.nan, "-")]
)
def test_numbers_are_short(value: float, text: str) -> None:
    assert Figure("x", value).row()[1] == text


def fails(_quick: bool) -> list[Figure]:
    raise RuntimeError("no such luck\nand a long story")


@pytest.fixture
def benchmarks(monkeypatch: pytest.MonkeyPatch) -> dict[str, object]:
    table = {
        "good": lambda quick: [Figure("speed", 7.0 if quick else 8.0, "x", 5.0, "at least")],
        "slow": lambda _quick: [Figure("time", 9.0, "us", 5.0, note="a long note")],
    }
    monkeypatch.setattr(run, "known", lambda: table)
    return table


def test_table_and_file(
    benchmarks: dict[str, object], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bench.json"
    assert run.main(["--json", str(path)]) == 0
    out = capsys.readouterr().out
    assert "speed  8 x" in out
    assert "NOT MET" in out
    kept = json.loads(path.read_text())
    assert [(f["benchmark"], f["met"]) for f in kept["figures"]] == [
        ("good", True),
        ("slow", False),
    ]
    assert kept["failed"] == {}
    assert kept["machine"]["cores"] >= 1
    assert 0 <= kept["machine"]["stolen_percent"] <= 100


def test_selected_quick_and_strict(
    benchmarks: dict[str, object], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run.main(["--quick", "--strict", "good"]) == 0
    assert "speed  7 x" in capsys.readouterr().out
    assert run.main(["--strict"]) == 1
    with pytest.raises(SystemExit, match="2"):
        run.main(["unknown"])
    assert "no benchmark 'unknown'; there are good, slow" in capsys.readouterr().err


def test_one_that_fails_does_not_stop_the_others(
    benchmarks: dict[str, object], capsys: pytest.CaptureFixture[str]
) -> None:
    del benchmarks["slow"]
    benchmarks.update(broken=fails, last=benchmarks["good"])
    assert run.main([]) == 1
    out = capsys.readouterr().out
    assert out.count("speed") == 2
    assert "benchmark broken failed: RuntimeError: no such luck\n" in out


def test_finds_the_benchmarks_of_the_folder() -> None:
    assert {"wakeup", "loop"} <= set(run.known())


def test_processor_without_a_name(tmp_path: Path) -> None:
    (tmp_path / "cpuinfo").write_text("processor : 0\n")
    assert run.processor(tmp_path / "cpuinfo")
    (tmp_path / "cpuinfo").write_text("model name\t: Fast One\n")
    assert run.processor(tmp_path / "cpuinfo") == "Fast One"
