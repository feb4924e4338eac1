"""One name, one class: a reader who meets a name need not ask which of them is meant. And names are
standard terms."""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCES = ROOT / "src" / "motord"

TWICE: dict[str, str] = {}
"""Names that more than one class has, and why."""

STANDARD = {
    "told": "configured, reported, received, expected",
    "tell": "report, send",
    "tells": "reports, has, shows",
    "heard": "received",
    "hear": "receive",
    "hears": "receives",
    "beside": "next_to, against, in_addition_to",
    "sure": "significant, complete, known, coverage_factor, confidence_level",
}
"""What a name says instead, by the word of everyday speech."""

KEPT = {"beside": "the option --beside of `motord analyse calibrate`"}
"""Names that stay, and why."""

_EVERYDAY = re.compile(rf"(?<![A-Za-z])({'|'.join(STANDARD)})(?![A-Za-z])", re.IGNORECASE)


def test_no_two_classes_have_the_same_name_without_a_reason():
    """Names with an underscore are seen in their own module alone, and may be repeated."""
    where = defaultdict(list)
    for path in SOURCES.rglob("*.py"):
        for name in re.findall(r"^ *class ([^\W_]\w*) *[(:[]", path.read_text(), re.MULTILINE):
            where[name].append(str(path.relative_to(SOURCES)))
    assert len(where) > 400
    twice = {name: paths for name, paths in where.items() if len(paths) > 1}
    assert twice.keys() <= TWICE.keys(), {n: p for n, p in twice.items() if n not in TWICE}


def test_names_are_standard_terms():
    assert set(everyday("def test_it_is_told(heard): self.hears = heard")) == {
        "test_it_is_told",
        "heard",
        "hears",
    }
    assert not set(everyday("def heartbeat(teller): foretold = 'it is told'"))
    found = {
        f"{path.relative_to(ROOT)}: {name}"
        for folder in ("src", "tests", "tools")
        for path in (ROOT / folder).rglob("*.py")
        for name in everyday(path.read_text())
    }
    assert not found, f"{sorted(found)}; rather: {STANDARD}"


def everyday(source: str) -> Iterator[str]:
    """Yield names of functions, classes, arguments, variables and attributes in `STANDARD`."""
    if not _EVERYDAY.search(source):
        return
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                pass
            case ast.ClassDef(name=name) | ast.arg(arg=name):
                pass
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                pass
            case _:
                continue
        if name not in KEPT and _EVERYDAY.search(name):
            yield name
