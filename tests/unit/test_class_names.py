"""One name, one class: a reader who meets a name need not ask which of them is meant."""

import ast
from collections import defaultdict
from pathlib import Path

SOURCES = Path(__file__).parents[2] / "src" / "motord"

TWICE: dict[str, str] = {}
"""Names that more than one class has, and why."""


def test_no_two_classes_have_the_same_name_without_a_reason():
    """Names with an underscore are seen in their own module alone, and may be repeated."""
    where = defaultdict(list)
    for path in SOURCES.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                where[node.name].append(str(path.relative_to(SOURCES)))
    assert len(where) > 400
    twice = {name: paths for name, paths in where.items() if len(paths) > 1}
    assert twice.keys() <= TWICE.keys(), {n: p for n, p in twice.items() if n not in TWICE}
