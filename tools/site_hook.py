"""Hooks of mkdocs: what the pages link to outside docs/ comes along, and patterns in the nav.

Pages link to files of the repository as they lie there, so that the links work where the
repository is read, too. A page outside docs/ (the firmware's, say) becomes a page of the site, any
other file a file to download.
"""

import posixpath
import re
from collections.abc import Iterator
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files, InclusionLevel
from mkdocs.structure.pages import Page
from tools.code_blocks import DOCS, ROOT

LINK = re.compile(r"(?P<open>\]\(|^\[[^\]]+\]:\s*)(?P<path>[^)#\s:]+)(?=[)#\s])", re.M)
"""An inline link or a reference; the path without anchor, none of an address."""
PROJECT = ("CONTRIBUTING.md", "CHANGELOG.md")
"""Pages of the repository that are in the nav."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the pages that there are in the place of patterns in the nav."""
    config.nav = _expanded(config.nav)
    return config


def _expanded(entry: Any) -> Any:
    if isinstance(entry, dict):
        return {title: _expanded(below) for title, below in entry.items()}
    if isinstance(entry, list):
        return [
            each for one in entry for each in (_matches(one) if _pattern(one) else [_expanded(one)])
        ]
    return entry


def _pattern(entry: Any) -> bool:
    return isinstance(entry, str) and "*" in entry


def _matches(pattern: str) -> list[str]:
    return sorted(path.relative_to(DOCS).as_posix() for path in DOCS.glob(pattern))


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what the pages link to outside docs/, and what that links to."""
    todo = [f"docs/{file.src_uri}" for file in files.documentation_pages()]
    todo += PROJECT
    seen = set(todo)
    while todo:
        name = todo.pop()
        if not name.startswith("docs/"):
            level = InclusionLevel.INCLUDED if name in PROJECT else InclusionLevel.NOT_IN_NAV
            path = ROOT / name
            files.append(File.generated(config, name, abs_src_path=str(path), inclusion=level))
        if name.endswith(".md"):
            found = set(_linked(name)) - seen
            seen |= found
            todo += sorted(one for one in found if not one.startswith("docs/"))
    return files


def _linked(name: str) -> Iterator[str]:
    """Yield the files of the repository that a page links to."""
    text = (ROOT / name).read_text(encoding="utf-8")
    for match in LINK.finditer(text):
        target = _target(name, match["path"])
        if (ROOT / target).is_file():
            yield target


def _target(name: str, link: str) -> str:
    """Return what a link in the file `name` leads to, both from the root of the repository."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(name), link))


def _place(name: str) -> str:
    """Return where a file of the repository is in the site."""
    return name.removeprefix("docs/")


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn links between files of the repository into links between files of the site."""
    place = page.file.src_uri
    name = place if (ROOT / place).is_file() and not (DOCS / place).is_file() else f"docs/{place}"

    def moved(match: re.Match[str]) -> str:
        target = _target(name, match["path"])
        if not (ROOT / target).is_file():
            return match[0]
        return match["open"] + posixpath.relpath(_place(target), posixpath.dirname(place) or ".")

    return LINK.sub(moved, markdown)
