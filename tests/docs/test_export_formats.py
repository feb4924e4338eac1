"""The table of formats in docs/how-to/compensate-in-a-drive.md is that of the registry."""

from motord.calibration.export import FORMATS
from tests.docs.blocks import ROOT

PAGE = ROOT / "docs" / "how-to" / "compensate-in-a-drive.md"


def test_the_table_of_formats_is_the_registry() -> None:
    expected = [
        f"| `{one.name}` | {one.drive} | {one.stored_text} | `{one.parameter}` |"
        for one in FORMATS.values()
    ]
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    begin = lines.index("| `--format` | for | what is stored | where |") + 2
    assert lines[begin : begin + len(expected) + 1] == [*expected, ""]


def test_every_source_is_named() -> None:
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    sources = [one.source for one in FORMATS.values() if one.source != "motord"]
    assert len(sources) == 3
    assert [source for source in sources if f"Sources: {source}" not in text] == []
