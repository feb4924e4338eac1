"""The page by keyboard alone, and what axe finds."""

import time

import pytest
from playwright.sync_api import expect

from tests.browser.axe import AXE, findings
from tests.browser.chromium import (
    PATIENCE_MS,
    PHONE,
    needs_browser,
    shows,
    start_plan,
    take_command,
)  # fmt: skip
from tests.browser.conftest import Watched
from tests.browser.stand_in import StandIn

pytestmark = [pytest.mark.system, needs_browser]


def test_all_of_it_by_keyboard(server, visit: Watched):
    page = visit(server.urls.operator)
    passed: list[str] = []

    def tab_to(wanted: str) -> None:
        """Go on from round to round: while no state comes, what commands cannot be reached."""
        end_s = time.monotonic() + PATIENCE_MS / 1000
        while time.monotonic() < end_s:
            page.keyboard.press("Tab")
            passed.append(page.evaluate(FOCUSED))
            if passed[-1] == wanted:
                outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
                assert outline == "solid", wanted
                return
        raise AssertionError(f"{wanted} is not reached: {passed}")

    tab_to("skip")
    tab_to("take")
    page.keyboard.press("Enter")
    shows(page, "#lease-text", "You are in command")
    tab_to("stop")
    tab_to("enable")
    page.keyboard.press("Enter")
    shows(page, "#state-name", "ENABLED")
    tab_to("torque-slider")
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    page.keyboard.press("Enter")
    shows(page, "#setpoint-now", "0.15")
    tab_to("plots")
    page.keyboard.press(" ")
    shows(page, "#held", "held at")
    tab_to("tab-calibration")
    page.keyboard.press("ArrowRight")
    expect(page.locator("#panel-health")).to_be_visible()
    shows(page, "#health-figures", "Channel winding_C")
    shows(page, "#health-figures", "131.50 degC, trip")
    shows(page, "#health-figures", "nothing has been read yet")
    tab_to("note")
    tab_to("skip")  # round once: nothing holds the focus
    page.keyboard.press("Escape")
    shows(page, "#stop-status", "Stopped")


FOCUSED = "(document.activeElement.id || document.activeElement.className).toString()"


@pytest.mark.skipif(not AXE.exists(), reason="needs packages: npm ci --prefix tests/node")
def test_axe_has_no_serious_findings(server, visit: Watched):
    page = visit(server.urls.operator, color_scheme="light")
    take_command(page)
    start_plan(page, torques_Nm="1, 2, 3", speeds_Hz="0.5 0.7 0.9")
    expect(page.locator("#mesh td.done").nth(5)).to_be_visible(timeout=PATIENCE_MS)
    known = {"targets": {"alpha_percent": 0.1, "beta_A": 0.02}, "known": {"beta_A": 0.01}}
    server.stand_in.do(lambda: server.stand_in.show_precision(**known, obstacle="it does not fit"))
    server.stand_in.do(server.stand_in.trip_over_current)
    shows(page, "#trip", "What to do")
    shows(page, "#plan-precision", "reached")
    server.stand_in.do(lambda: queue_that_failed(server.stand_in))
    shows(page, "#queue-items", "1 attempt")
    page.click("#queue-ended > summary")
    page.click("#plan-start-box > summary")
    page.evaluate(AXE.read_text())  # by the debugger: the page's policy lets no other script in
    for tab in ("health", "page", "calibration"):
        page.click(f"#tab-{tab}")
        assert findings(page, f"#panel-{tab}") == [], tab
    assert findings(page) == []
    page.emulate_media(color_scheme="dark")
    assert findings(page) == [], "dark"
    page.set_viewport_size(PHONE)
    assert findings(page) == [], "dark, phone"
    page.emulate_media(color_scheme="light")
    assert findings(page) == [], "phone"


@pytest.mark.skipif(not AXE.exists(), reason="needs packages: npm ci --prefix tests/node")
def test_what_is_old_can_be_read_as_well(server, visit: Watched):
    page = visit(server.urls.operator, color_scheme="light")
    server.stand_in.do(lambda: queue_that_failed(server.stand_in))
    shows(page, "#queue-items", "1 attempt")
    server.stand_in.do(lambda: setattr(server.stand_in, "silent", True))
    expect(page.locator("body")).to_have_attribute("data-stale", "true")
    page.evaluate(AXE.read_text())
    assert findings(page) == [], "light"
    page.emulate_media(color_scheme="dark")
    assert findings(page) == [], "dark"


def queue_that_failed(stand_in: StandIn) -> None:
    """Give the stand-in a queue of two plans, of which the first has failed."""
    waits = [{"channel": "winding_C", "below": 40}]
    stand_in.queue.add([{"name": "calibrate"}, {"name": "verify", "wait": waits}])
    stand_in.queue.start("")
    stand_in.queue.end("failed", "the speed was 3 % off")
