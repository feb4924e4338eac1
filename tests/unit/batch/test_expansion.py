"""Files, folders and patterns: each recording once, in an order that depends on names alone."""

import os

import pytest

from motord.batch.error import BatchError
from motord.batch.expansion import expand, names_many


@pytest.fixture
def tree(tmp_path, monkeypatch):
    for name in ("b.mcap", "a.mcap", "x/c.mcap", "x/y/d.mcap", "x/note.txt", "[1].mcap", ".h.mcap"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
    (tmp_path / "x" / "folder.mcap").mkdir()
    (tmp_path / "x" / "z.mcap").symlink_to(tmp_path / "a.mcap")
    (tmp_path / "x" / "loop").symlink_to(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("given", "names"),
    [
        (["b.mcap", "a.mcap"], ["b.mcap", "a.mcap"]),
        (["*.mcap"], ["[1].mcap", "a.mcap", "b.mcap"]),
        (["x/*"], ["x/c.mcap", "x/note.txt", "x/z.mcap"]),
        (["x/**/*.mcap"], ["x/c.mcap", "x/y/d.mcap", "x/z.mcap"]),
        (["x"], ["x/c.mcap", "x/y/d.mcap", "x/z.mcap"]),
        (["b.mcap", "."], ["b.mcap", "[1].mcap", "a.mcap", "x/c.mcap", "x/y/d.mcap"]),
        (["[1].mcap"], ["[1].mcap"]),
        (["[ab].mcap", "[ab].mcap"], ["a.mcap", "b.mcap"]),
        (["none.mcap"], ["none.mcap"]),
    ],
)
def test_what_is_meant(tree, given, names):
    paths = [tree / name for name in given]
    assert [str(path.relative_to(tree)) for path in expand(paths)] == names
    os.chdir(tree)
    assert list(map(str, expand([path.relative_to(tree) for path in paths]))) == names


@pytest.mark.parametrize("given", ["c*.mcap", "x/note*/*.mcap", "x/folder.mcap"])
def test_nothing_that_is_meant_is_an_error(tree, given):
    with pytest.raises(BatchError, match="no recordings there"):
        expand([tree / "a.mcap", tree / given])


def test_a_folder_or_a_pattern_names_many_a_file_one(tree):
    assert names_many(tree / "x")
    assert names_many(tree / "*.mcap")
    assert not names_many(tree / "[1].mcap")
    assert not names_many(tree / "none.mcap")
