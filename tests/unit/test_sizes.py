"""No module is too long to read, and no folder too full to look over."""

from pathlib import Path

SOURCES = Path(__file__).parents[2] / "src" / "motord"
LINES_MAX = 300
FILES_MAX = 16


def test_modules_and_folders_are_small():
    modules = list(SOURCES.rglob("*.py"))
    assert len(modules) > 700
    long = {
        str(path.relative_to(SOURCES)): lines
        for path in modules
        if (lines := len(path.read_text().splitlines())) > LINES_MAX
    }
    full = {
        str(folder.relative_to(SOURCES)): files
        for folder in {path.parent for path in modules}
        if (files := len(list(folder.glob("*.py")))) > FILES_MAX
    }
    assert (long, full) == ({}, {})
