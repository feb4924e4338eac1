"""The whole way: a simulated daemon, `motord dashboard`, and a person in front of the page."""

from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.browser.chromium import (
    needs_browser,
    press,
    set_by_hand,
    shows,
    start_plan,
    take_command,
)
from tests.browser.conftest import Watched
from tests.system.daemons import Daemon, Program, write_sim

pytestmark = [pytest.mark.system, needs_browser]

SPEEDS_HZ = " ".join(f"{0.8 + 0.001 * number:.3f}" for number in range(60))
"""Times three torques: a plan of ten minutes, which does not end by itself."""


def test_a_person_operates_a_bench(tmp_path: Path, visit: Watched) -> None:
    path = write_sim(tmp_path, "browser")
    daemon = Daemon(tmp_path, path)
    connected = ("--bench", "browser", "--connect", daemon.endpoint)
    dashboard = Program(tmp_path, "dashboard", "--port", "0", "--no-browser", *connected)
    try:
        page = visit(dashboard.first_line.strip())
        take_command(page)
        set_by_hand(page, 2.0, 0.7)
        shows(page, "#setpoint-now", "2.00")
        reached = f"Math.abs(parseFloat({SET_POINT}) - 2) < 0.05 && parseFloat({SPEED}) > 0.3"
        page.wait_for_function(f"() => {reached}", polling=100)
        press(page, "#zero")
        shows(page, "#setpoint-now", "0.00")
        page.fill("#note", "by hand")
        page.press("#note", "Enter")
        shows(page, "#event-list", "by hand")
        press(page, "#disable")
        shows(page, "#state-name", "READY")
        mesh = {"torques_Nm": "2 2.1 2.2", "speeds_Hz": SPEEDS_HZ, "turns": "2", "gain_steps": ""}
        start_plan(page, **mesh, settle_s="0.3")
        done = page.locator("#mesh td.done")
        expect(done.first).to_be_visible()
        assert 0.1 < float(done.first.inner_text().rstrip(" !")) < 20
        page.keyboard.press("Escape")
        shows(page, "#stop-status", "Stopped: the daemon reports OFF")
        shows(page, "#plan-state", "aborted")
        visit.close()
    finally:
        dashboard.end()
        daemon.close()


ROWS = "document.querySelectorAll('.trace-row')"
SET_POINT = f"{ROWS}[0].querySelectorAll('.value')[1].textContent"
SPEED = f"{ROWS}[2].querySelector('.value').textContent"
