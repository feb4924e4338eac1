"""Texts of findings."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import motord
from motord.findings import listed


@pytest.mark.parametrize(
    ("count", "most", "text"),
    [(1, 1, "0"), (2, 1, "0 and 1 more"), (4, 4, "0; 1; 2; 3"), (6, 4, "0; 1; 2; 3 and 2 more")],
)
def test_of_many_the_first_are_listed(count: int, most: int, text: str) -> None:
    assert listed([str(n) for n in range(count)], most) == text


def test_a_text_that_comes_again_is_listed_once_with_how_many_times() -> None:
    assert listed(["a", "b", "a", "a", "c"], 2) == "a (3 times); b and 1 more"


def _names(file: Path) -> Iterator[str]:
    """Yield the literal names of findings in a module; of a formatted one, what is literal."""
    source = file.read_text()
    for node in ast.walk(ast.parse(source)) if "Finding(" in source else ():
        if not (isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Finding"):
            continue
        named = [word.value for word in node.keywords if word.arg == "name"]
        for one in ast.walk([*named, *node.args][0]) if named or node.args else ():
            if isinstance(one, ast.Constant) and isinstance(one.value, str):
                yield one.value


def test_names_of_findings_are_small_letters_with_hyphens() -> None:
    root = Path(motord.__file__).parent
    names = {name for file in root.rglob("*.py") for name in _names(file)}
    assert {"directions-differ", "few-steps", "windage"} <= names
    assert not {name for name in names if not re.fullmatch("[a-z0-9-]+", name)}
