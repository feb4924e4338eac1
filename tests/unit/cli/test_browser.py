"""Pages are opened where somebody sits, and nowhere else."""

import io
import webbrowser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from motord.cli import reproduce as demo_module
from motord.cli import viewers
from motord.cli.viewers import open_page

URL = "file:///tmp/report.html"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is opened, of somebody at a terminal with a display."""
    pages: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda url: pages.append(url) or True)
    at_a_terminal = SimpleNamespace(stdin=Terminal(), stdout=Terminal(), platform="linux")
    monkeypatch.setattr(viewers, "sys", at_a_terminal)
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.delenv("CI", raising=False)
    return pages


def test_at_a_terminal_with_a_display(opened: list[str]) -> None:
    assert open_page(URL)
    assert opened == [URL]


@pytest.mark.parametrize("stream", ["stdin", "stdout"])
def test_not_in_a_pipe(opened: list[str], stream: str) -> None:
    setattr(viewers.sys, stream, io.StringIO())
    assert not open_page(URL)
    assert opened == []


def test_not_without_a_display(opened: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert not open_page(URL)
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    assert open_page(URL)


def test_not_in_continuous_integration(opened: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CI", "true")
    assert not open_page(URL)
    assert opened == []


def test_a_browser_that_cannot_be_started(
    opened: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(url: str) -> bool:
        raise webbrowser.Error("no browser")

    monkeypatch.setattr(webbrowser, "open", fails)
    assert not open_page(URL)


@pytest.mark.parametrize(
    ("options", "pages"), [({}, 1), ({"no_browser": True}, 0), ({"json": True}, 0)]
)
def test_the_demo_ends_with_its_report(
    opened: list[str],
    options: dict[str, Any],
    pages: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    report = tmp_path / "my report.html"
    found = SimpleNamespace(files={"report": report}, summary={})
    monkeypatch.setattr("motord.reproduce.demo.run_demo", lambda *_: found)
    monkeypatch.setattr("motord.reproduce.demo.write_report", lambda _: None)
    monkeypatch.setattr(demo_module, "_print_demo", lambda _: None)
    demo_module.demo(out=tmp_path, **options)
    assert opened == [report.as_uri()] * pages
