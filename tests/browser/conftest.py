"""A browser for the tests of this folder, and pages whose console and requests are watched."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any
from unittest import mock
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, Page, Playwright, sync_playwright

from motord.dashboard.app import HEADERS
from tests.browser.chromium import DESKTOP, launch, leave, new_page, shows
from tests.browser.stand_in import Server, StandIn
from tests.support.ports import free_port

Serve = Callable[[StandIn], Server]


@pytest.fixture(scope="package")
def playwright() -> Iterator[Playwright]:
    """Run Playwright, whose event loop would be in the way of other folders."""
    with sync_playwright() as running:
        yield running


class LiveBrowser:
    """One browser, started anew if it has died: that fails one test, not all after it."""

    def __init__(self, playwright: Playwright) -> None:
        self._playwright = playwright
        self._started: Browser | None = None

    def __call__(self) -> Browser:
        if self._started is None or not self._started.is_connected():
            self._started = launch(self._playwright)
        return self._started


@pytest.fixture(scope="package")
def live_browser(playwright: Playwright) -> LiveBrowser:
    """Return what gives the browser of all tests here."""
    return LiveBrowser(playwright)


@pytest.fixture
def browser(live_browser: LiveBrowser) -> Browser:
    """Return the browser."""
    return live_browser()


class Watched:
    """Opens pages; collects what their consoles say and what they ask for.

    Each has a context of its own. They are left at the end of a test, and open again in the next.
    """

    def __init__(self, browser: LiveBrowser) -> None:
        self.complaints: list[str] = []
        self.expected = ""
        """What a complaint may have in it."""
        self._browser = browser
        self._left: list[Page] = []
        self._pages: list[Page] = []

    def __call__(
        self, url: str, size: Any = DESKTOP, *, live: bool = True, color_scheme: Any = "light"
    ) -> Page:
        """Open a page and wait until it is live, unless it will not be."""
        browser = self._browser()
        self._left = [page for page in self._left if page.context.browser is browser]
        page = self._left.pop() if self._left else self._new_page()
        self._pages.append(page)
        page.set_viewport_size(size)
        page.emulate_media(color_scheme=color_scheme, reduced_motion="no-preference")
        page.goto(url)
        if live:
            shows(page, "#link-text", "live")
        return page

    def _new_page(self) -> Page:
        page = new_page(self._browser())
        self._watch(page)
        return page

    def _watch(self, page: Page) -> None:
        page.on("console", lambda said: self._note(said.type, said.text))
        page.on("pageerror", lambda error: self._note("error", str(error)))
        page.on("request", lambda request: self._asked(request.url))

    def _note(self, kind: str, text: str) -> None:
        if kind in ("error", "warning") and not (self.expected and self.expected in text):
            self.complaints.append(f"{kind}: {text}")

    def _asked(self, url: str) -> None:
        parts = urlsplit(url)
        if parts.hostname != "127.0.0.1" and parts.scheme not in ("data", "blob"):
            self.complaints.append(f"asked another machine: {url}")

    def close(self) -> None:
        """Leave the pages; none may have complained."""
        pages, self._pages = self._pages, []
        try:
            for page in pages:
                leave(page)  # one that cannot be left is not opened again
                self._left.append(page)
        finally:
            complaints, self.complaints, self.expected = self.complaints, [], ""
        assert complaints == []


@pytest.fixture(scope="package")
def port() -> Iterator[int]:
    """Return the port of the stand-ins, from which the browser keeps the page's files.

    Else it would get, compile and compare them anew in every test.
    """
    with mock.patch.dict(HEADERS, {"Cache-Control": "max-age=3600"}):
        yield free_port()


@pytest.fixture
def serve(port: int) -> Iterator[Serve]:
    """Serve stand-ins to the end of the test, when no page of `visit` is open any more."""
    with ExitStack() as stack:
        yield lambda stand_in: stack.enter_context(Server(stand_in, port))


@pytest.fixture
def server(serve: Serve) -> Server:
    """Return the server of a stand-in."""
    return serve(StandIn())


@pytest.fixture(scope="package")
def watched(live_browser: LiveBrowser) -> Watched:
    """Return what opens the pages."""
    return Watched(live_browser)


@pytest.fixture
def visit(watched: Watched, serve: Serve) -> Iterator[Watched]:
    """Open pages; at the end no console has had an error, and nothing left this machine.

    They are closed before the servers: one that misses its server complains in its console.
    """
    yield watched
    watched.close()
