"""The pages of docs/reference are what the code makes, and say something of everything."""

import ast
import re
from functools import cache

import pytest
from tools.code_blocks import REFERENCE, ROOT
from tools.reference import __main__ as reference
from tools.reference.keys_and_events import EVENT_MEANING, KEYS

from motord.api.requests import RPCS
from motord.security.access import WATCHED

PAGES = {name: cache(make) for name, make in reference.PAGES.items()}
"""What makes each page, once, and not before a test asks."""


@pytest.fixture(autouse=True)
def _made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference, "PAGES", dict(PAGES))


def test_the_pages_are_what_the_code_makes(capsys: pytest.CaptureFixture[str]) -> None:
    assert reference.main(["--check"]) == 0, capsys.readouterr().err
    assert {path.name for path in REFERENCE.iterdir()} == set(reference.PAGES)


def test_a_page_that_is_not_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(reference.PAGES, "cli.md", lambda: "other")
    assert reference.main(["--check"]) == 1
    assert "docs/reference/cli.md is not what the code makes: make reference" in (
        capsys.readouterr().err
    )


@pytest.mark.parametrize(
    "name", ["bench-file.md", "import-map.md", "motor-type.md", "rpc.md", "recording.md"]
)
def test_every_key_field_and_flag_has_a_meaning(name: str) -> None:
    rows = [line for line in PAGES[name]().splitlines() if line.startswith("| ")]
    without = [row for row in rows if re.search(r"\|\s*\|$", row) and not _link(row)]
    assert not without


def _link(row: str) -> bool:
    """Return whether a row is one of an overview, whose last cell is yes or nothing."""
    return row.startswith(("| [`", "| `state` | the", "| `tick", "| `alive`"))


def test_every_command_every_request_and_every_key_is_there() -> None:
    for command in ("demo", "plan start", "analyse calibrate", "record export", "latency"):
        assert re.search(f"^##+ motord {command}$", PAGES["cli.md"](), re.M)
    for name, rpc in RPCS.items():
        assert f"\n### {name}\n" in PAGES["rpc.md"]()
        assert rpc.request.__doc__
    assert set(WATCHED) <= {name for name, *_ in KEYS}


def test_every_kind_of_event_has_a_meaning() -> None:
    kinds = {}
    for path in (ROOT / "src/motord").rglob("*.py"):
        text = path.read_text()
        if "emit" not in text and "event" not in text:
            continue  # not parsed, which takes most of the time
        for node in ast.walk(ast.parse(text)):
            match node:
                case (
                    ast.Call(func=ast.Attribute(attr="emit"), args=[ast.Constant(str(kind)), *_])
                    | ast.Call(
                        func=ast.Attribute(attr="event"), args=[_, ast.Constant(str(kind)), *_]
                    )
                ):
                    kinds[kind] = path
    assert len(kinds) > 20
    assert set(kinds) <= set(EVENT_MEANING), "describe it in tools/reference/keys_and_events.py"
