"""The site is built without a warning, whole, and of nothing but its own files."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import pytest
from tools.code_blocks import DOCS, ROOT, pages

IMAGES = DOCS / "images"
OTHERS = ("CHANGELOG.md", "tests/README.md")
LOADED = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src"}
"""What a browser loads by itself, unlike the `href` of `a`."""
BUILD_S = 120.0


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    built = build(ROOT / "mkdocs.yml", folder)
    assert (built.returncode, built.stdout, built.stderr) == (0, "", "")
    return folder


def build(config: Path, folder: Path) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--quiet", "-f", str(config), "-d", str(folder)],
        cwd=ROOT, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}, check=False,
        capture_output=True, text=True, timeout=BUILD_S,
    )  # fmt: skip


class Loads(HTMLParser):
    """What a page makes a browser load, and its images without a text in their place."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.without_text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag in LOADED and (address := given.get(LOADED[tag])):
            self.found.append(address)
        if tag == "img" and not given.get("alt"):
            self.without_text.append(str(given.get("src")))


def test_nothing_comes_from_another_machine(site: Path) -> None:
    made = sorted(site.rglob("*.html"))
    assert len(made) > 40
    for page in made:
        loads = Loads()
        loads.feed(page.read_text())
        for address in loads.found:
            assert not re.match(r"(\w+:)?//", address), f"{page.name} loads {address}"
            path = page.parent / address.partition("#")[0].partition("?")[0]
            assert page.name == "404.html" or path.resolve().exists(), f"{page.name}: {address}"
        assert not loads.without_text, page.name
    for style in site.rglob("*.css"):
        assert not re.search(r"(url\(|@import\s*)[\"']?(\w+:)?//", style.read_text()), style


def test_every_page_is_there_and_reached_by_the_menu(site: Path) -> None:
    start = (site / "index.html").read_text()
    for page in DOCS.rglob("*.md"):
        made = page.relative_to(DOCS).with_suffix(".html").as_posix()
        made = made.replace("README.html", "index.html")
        assert (site / made).exists()
        assert f'href="{made}"' in start, f"{made} is not in the nav of mkdocs.yml"


def test_what_pages_link_to_outside_the_folder_comes_along(site: Path) -> None:
    assert (site / "firmware_bridge/index.html").exists()
    assert (site / "src/motord/proto/tick.proto").read_text().startswith("//")
    assert (
        'href="../src/motord/proto/tick.proto"' in (site / "reference/recording.html").read_text()
    )


def test_the_search_index_has_the_reference(site: Path) -> None:
    index = (site / "search/search_index.json").read_text()
    assert "reference/bench-file.html#limits" in index


def written() -> list[Path]:
    """Return all pages that are written or made, as they lie in the repository."""
    return [*pages(), *(ROOT / name for name in OTHERS)]


def links(page: Path) -> Iterator[tuple[bool, str, str]]:
    """Yield the links of a page: whether an image, text, target."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.M | re.S)
    text = re.sub(r"`[^`\n]*`", "`", text)
    for match in re.finditer(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)", text):
        yield bool(match[1]), match[2], match[3]


@cache
def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.M | re.S)
    found = set()
    for heading in re.findall(r"^#+ (.*)$", text, re.M):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        found.add(re.sub(r"[^\w\- ]", "", plain).strip().replace(" ", "-"))
    return found


@pytest.mark.parametrize("page", written(), ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for image, text, target in links(page):
        if re.match(r"\w+:", target):
            assert not image, f"{target} comes from another machine"
            continue
        path, _, anchor = target.partition("#")
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), f"{page.name}: {target} is not there"
        if anchor:
            assert anchor in anchors(there), f"{page.name}: {target} has no such heading"
        if image:
            assert len(text) > 10, f"{page.name}: {target} needs a text that says what it shows"


def test_every_picture_is_used() -> None:
    used = {
        (page.parent / target).resolve()
        for page in written()
        for image, _, target in links(page)
        if image and "://" not in target
    }
    used.add(IMAGES / "favicon.svg")  # mkdocs.yml
    assert used >= {path.resolve() for path in IMAGES.iterdir()}


def test_the_moving_picture_is_small_and_stands_still_on_request() -> None:
    picture = (IMAGES / "ripple.svg").read_text()
    assert len(picture) < 100_000
    moving = picture.split("@media (prefers-reduced-motion: no-preference)")[1]
    rules = moving.split("@keyframes")[0]
    assert rules.count("animation:") == picture.count("animation:"), "moves for everybody"
    assert "http" not in picture.replace("http://www.w3.org/2000/svg", "")
