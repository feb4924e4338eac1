"""`motord reproduce` in its quick form: every figure and table of the report is on the page."""

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.virtual import mesh  # noqa: F401  # so that its processes are kept (`conftest`)

pytestmark = pytest.mark.slow

FIGURES = (
    "2.2",
    "2.4",
    "2.5",
    "2.6",
    "2.9",
    "3.2",
    "3.3",
    "3.4",
    "4.3",
    "4.4",
    "4.5",
    "4.6",
    "4.9",
)
FIGURES += ("4.10", "4.11")


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    folder = tmp_path_factory.mktemp("reproduce") / "out"
    options = ["--quick", "--json", "--keep-recordings", "--out", str(folder)]
    ran = CliRunner().invoke(app, ["reproduce", *options])
    assert ran.exit_code == 0, ran.output
    return folder, json.loads(ran.stdout)


def test_every_figure_and_table_is_there(done: tuple[Path, dict]) -> None:
    folder, _ = done
    page = (folder / "reproduce.html").read_text()
    assert page.count("<svg") >= 20
    text = re.sub(r"<svg.*?</svg>", " ", page, flags=re.DOTALL)
    for figure in FIGURES:
        assert re.search(rf"Figures?[^.]*? [^<]*?\b{re.escape(figure)}\b", text), figure
    for table in ("Table 4.1", "Table 4.2"):
        assert table in text
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_the_numbers_stand_next_to_the_reports(done: tuple[Path, dict]) -> None:
    folder, printed = done
    kept = json.loads((folder / "reproduce.json").read_text())
    assert kept["beside"] == printed["beside"]
    assert list(printed["beside"]) == [
        "Moment of inertia", "Cogging torque", "Calibration", "Sensitivity", "What remains",
        "Beyond the report",
    ]  # fmt: skip
    rows = [row for chapter in printed["beside"].values() for row in chapter]
    assert all(row["report"] and row["here"] for row in rows)
    assert len([row for row in rows if row["why"]]) >= 10
    assert len(list(folder.glob("*.mcap"))) == 9
