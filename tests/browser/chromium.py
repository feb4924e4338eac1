"""The system's Chromium, and what a person does with the page."""

import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, Playwright, expect, sync_playwright

NAMES = ("chromium-headless-shell", "chromium", "chromium-browser")
"""The first one draws alike, and takes four fifths of the processor time."""
PATH = next(filter(None, map(shutil.which, NAMES)), "")
needs_browser = pytest.mark.skipif(not PATH, reason="needs a browser: apt-get install chromium")
ARGUMENTS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update",
]  # fmt: skip
DESKTOP = {"width": 1440, "height": 900}
NARROW = {"width": 1100, "height": 880}
PHONE = {"width": 390, "height": 844}
PATIENCE_MS = 60_000
"""What waits longer waits for ever."""
POLLING_MS = 100
expect.set_options(timeout=PATIENCE_MS)


@contextmanager
def chromium() -> Iterator[Browser]:
    """Run a browser."""
    with sync_playwright() as playwright:
        browser = launch(playwright)
        yield browser
        browser.close()


def launch(playwright: Playwright) -> Browser:
    """Start a browser, which ends with Playwright."""
    return playwright.chromium.launch(executable_path=PATH, args=ARGUMENTS)


def new_page(browser: Browser, size: Any = DESKTOP, **options: Any) -> Page:
    """Open an empty page in a context of its own."""
    context = browser.new_context(viewport=size, **options)
    context.set_default_timeout(PATIENCE_MS)
    return context.new_page()


def open_page(browser: Browser, url: str, size: Any = DESKTOP, **options: Any) -> Page:
    """Open a page in a context of its own, and wait until it is live."""
    page = new_page(browser, size, **options)
    page.goto(url)
    shows(page, "#link-text", "live")
    return page


LEAVE = """() => {
  localStorage.clear();
  sessionStorage.clear();
  location.replace("about:blank");
}"""


def leave(page: Page) -> None:
    """Empty a page, as `new_page` gives it, but for its process: its start takes half a second."""
    page.evaluate(LEAVE)
    page.wait_for_url("about:blank")
    page.mouse.move(0, 0)


def shows(page: Page, selector: str, text: str) -> None:
    """Wait until an element has a text in it."""
    expect(page.locator(selector)).to_contain_text(text)


NOTE_CLICKS = """selector => {
  window.clicked = false;
  const note = event => { window.clicked ||= event.target.closest(selector) !== null; };
  document.addEventListener("click", note, {capture: true});
}"""


def press(page: Page, selector: str) -> None:
    """Click a button, again if it was disabled just then, as it is while no state comes.

    Whether it may be clicked is seen before the mouse moves: on a busy computer long before.
    """
    page.evaluate(NOTE_CLICKS, selector)
    while not page.evaluate("window.clicked"):
        page.click(selector)


def press_by_key(page: Page, selector: str) -> None:
    """Do so with the keyboard, which needs the button to have the focus and to be allowed."""
    page.evaluate(NOTE_CLICKS, selector)
    while not page.evaluate("window.clicked"):
        expect(page.locator(selector)).to_be_enabled()
        page.focus(selector)
        page.keyboard.press("Enter")


def take_command(page: Page) -> None:
    """Take the lease and enable the bench."""
    press(page, "#take")
    shows(page, "#lease-text", "You are in command")
    press(page, "#enable")
    shows(page, "#state-name", "ENABLED")


def set_by_hand(page: Page, torque_Nm: float, speed_Hz: float) -> None:
    """Set torque and speed with the keyboard."""
    page.fill("#speed", str(speed_Hz))
    page.press("#speed", "Enter")
    page.fill("#torque", str(torque_Nm))
    page.press("#torque", "Enter")


def start_plan(page: Page, name: str = "calibrate", **settings: str) -> None:
    """Fill the form of a plan, check it, start it."""
    page.click("#plan-start-box > summary")
    page.select_option("#plan-choice", name)
    for setting, text in settings.items():
        page.fill(f"#setting-{setting}", text)
    press(page, "#plan-check")
    shows(page, "#plan-outline", "within the limits")
    press(page, "#plan-start")
    shows(page, "#plan-state", "running")


def waits(page: Page, condition: str, argument: Any = None) -> None:
    """Wait until a condition in JavaScript holds, without a frame for each look."""
    page.wait_for_function(condition, arg=argument, polling=POLLING_MS, timeout=PATIENCE_MS)


def until(page: Page, condition: Callable[[], bool]) -> None:
    """Wait until a condition holds, while the page goes on."""
    end_s = time.monotonic() + PATIENCE_MS / 1000
    while not condition():
        assert time.monotonic() < end_s
        page.wait_for_timeout(20)
