"""Pages in Chromium that say when each frame was to be seen, and what it cost."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from playwright.sync_api import Browser, Page

from tests.browser.chromium import DESKTOP, PATIENCE_MS, chromium, shows

EMPTY = "about:blank"
WATCH = """
window.seen = {};
window.begin = () => {
  Object.assign(seen, { frames: 0, bytes: 0, delays_ms: [], since_ms: performance.now() });
};
begin();
window.WebSocket = class extends WebSocket {
  constructor(...how) {
    super(...how);
    this.addEventListener('message', (event) => { seen.bytes += event.data.byteLength; });
  }
};
let waiting = false;
new PerformanceObserver((list) => {
  const frames = list.getEntriesByName('motord.frame');
  seen.frames += frames.length;
  if (waiting || frames.length === 0 || seen.frames % 4) return;
  waiting = true;
  const sampled_ms = 1000 * frames.at(-1).detail.sampled_s;
  requestAnimationFrame(() => {
    waiting = false;
    seen.delays_ms.push(Date.now() - sampled_ms);
  });
}).observe({ entryTypes: ['measure'] });
"""
"""A frame is on the screen, at the latest, when the browser asks for the next one."""


@dataclass(frozen=True)
class Seen:
    """What a page drew in a while: frames a second, delays from sample to screen, what came."""

    frames_Hz: float
    delays_ms: list[float]
    kB_per_s: float
    lost: str


class OpenPages:
    """Pages of `motord dashboard`, each in a context of its own, empty until they are opened."""

    def __init__(self, browser: Browser, url: str, count: int) -> None:
        self._url = url
        self._pages = [self._empty_page(browser) for _ in range(count)]

    def _empty_page(self, browser: Browser) -> Page:
        context = browser.new_context(viewport=DESKTOP)
        context.set_default_timeout(PATIENCE_MS)
        context.add_init_script(WATCH)
        page = context.new_page()
        page.goto(EMPTY)
        return page

    def open(self) -> None:
        """Open the pages and wait until they draw."""
        for page in self._pages:
            page.goto(self._url)
        for page in self._pages:
            shows(page, "#link-text", "live")
            page.wait_for_function("() => seen.frames > 4")

    def close(self) -> None:
        """Leave the pages empty."""
        for page in self._pages:
            page.goto(EMPTY)

    def begin(self) -> None:
        """Count from now on."""
        for page in self._pages:
            page.evaluate("begin()")

    def seen(self) -> list[Seen]:
        """Return what each page saw since `begin`."""
        return [_seen(page.evaluate(COUNTS)) for page in self._pages]


COUNTS = """() => ({ ...seen, s: (performance.now() - seen.since_ms) / 1000,
  lost: document.querySelector('#lost').textContent })"""


def _seen(counts: dict[str, Any]) -> Seen:
    s = counts["s"]
    return Seen(
        counts["frames"] / s, counts["delays_ms"], counts["bytes"] / s / 1e3, counts["lost"]
    )


@contextmanager
def open_pages(url: str, count: int) -> Iterator[OpenPages]:
    """Run a browser with so many pages."""
    with chromium() as browser:
        yield OpenPages(browser, url, count)
