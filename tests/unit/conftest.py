"""What spares the time of several folders' tests: processes that are kept, pictures not drawn.

And what looks at all pages that they make: numbers on cards have intervals.

Processes that compute operating points take seconds to start. Tests that interrupt some have their
own (`tests/unit/virtual/test_mesh.py`).
"""

import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import pytest

from tests.support.key_figures import check_cards


@pytest.fixture(scope="session")
def kept_pools() -> Iterator[list[ProcessPoolExecutor]]:
    pools: list[ProcessPoolExecutor] = []
    yield pools
    for pool in pools:
        pool.shutdown()


@pytest.fixture(scope="module", autouse=True)
def kept_processes(kept_pools: list[ProcessPoolExecutor]) -> Iterator[None]:
    mesh: Any = sys.modules.get("motord.virtual.mesh")
    if mesh is None:
        yield
        return

    class Kept(mesh._Processors):  # type: ignore[misc]
        """A pool that outlives the blocks that use it."""

        def __exit__(self, *_error: object) -> None:
            pass

    def kept(*arguments: Any) -> ProcessPoolExecutor:
        if not kept_pools:
            kept_pools.append(Kept(*arguments))
        return kept_pools[0]

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(mesh, "_Processors", kept)
        yield


@pytest.fixture(scope="module", autouse=True)
def checked_cards() -> Iterator[None]:
    """Look at the key figures of every page that a test makes."""
    html: Any = sys.modules.get("motord.report.html")
    if html is None:
        yield
        return
    cards = html.Page.cards

    def checked(page: Any, figures: Sequence[tuple[str, str]]) -> None:
        check_cards(figures)
        cards(page, figures)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(html.Page, "cards", checked)
        yield


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spare the time of drawing the pictures of a page, of which only the text is looked at."""
    monkeypatch.setattr("motord.report.html.inline", lambda *_: "")
