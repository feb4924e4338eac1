"""Plans on the page: their form, mesh, targets, progress and queue."""

import pytest
from playwright.sync_api import expect

from tests.browser.chromium import (
    NARROW,
    needs_browser,
    press,
    press_by_key,
    shows,
    start_plan,
    take_command,
    until,
    waits,
)  # fmt: skip
from tests.browser.conftest import Serve, Watched
from tests.browser.stand_in import StandIn
from tests.browser.stand_in_requests import names

pytestmark = [pytest.mark.system, needs_browser]


HOSTILE = "<script>alert(1)</script>"


def test_a_sweep_fills_its_mesh(server, visit: Watched):
    page = visit(server.urls.operator)
    take_command(page)
    page.click("#plan-start-box > summary")
    page.fill("#setting-turns", "1")
    press(page, "#plan-check")
    shows(page, "#plan-outline", "at least 2")
    expect(page.locator("#plan-start")).to_be_disabled()
    page.click("#plan-start-box > summary")
    server.stand_in.points_max = 1  # until it is paused, however long that takes
    start_plan(page, torques_Nm="1, 2", speeds_Hz="0.5 0.75", turns="2")
    expect(page.locator("#mesh td.done")).to_have_count(1)
    press(page, "#plan-pause")
    shows(page, "#plan-state", "paused")
    server.stand_in.points_max = 1000
    press(page, "#plan-resume")
    shows(page, "#plan-state", "done")
    expect(page.locator("#mesh td.done")).to_have_count(4)
    cell = page.locator("#mesh tbody tr").nth(1).locator("td").nth(0)
    assert float(cell.inner_text()) == pytest.approx(1.1 + 0.42 + 0.15, abs=0.005)
    assert cell.evaluate("e => e.style.backgroundColor").startswith("rgb(")
    sent = [a for n, a in server.stand_in.requests if n == "plan/start" and not a.get("dry_run")]
    assert sent[0]["settings"] == {"torques_Nm": [1, 2], "speeds_Hz": [0.5, 0.75], "turns": 2}


def test_the_form_has_the_defaults_of_the_daemon_that_is_there(server, visit: Watched):
    stand_in = server.stand_in
    page = visit(server.urls.operator)
    press(page, "#take")
    page.click("#plan-start-box > summary")
    page.fill("#setting-turns", "7")
    stand_in.do(stand_in.connect_again)
    until(page, lambda: names(server).count("plan/list") == 2)
    press(page, "#plan-check")
    shows(page, "#plan-outline", "within the limits")
    expect(page.locator("#setting-turns")).to_have_value("7")
    [calibrate, *_] = stand_in.plans
    calibrate["fields"][3]["default"] = 5.0
    stand_in.do(stand_in.connect_again)
    expect(page.locator("#setting-settle_s")).to_have_value("5")
    expect(page.locator("#plan-start")).to_be_disabled()
    shows(page, "#plan-start-why", "Check it first")


def test_a_plan_that_is_discarded_leaves_no_mesh(server, visit: Watched):
    page, stand_in = visit(server.urls.operator), server.stand_in
    take_command(page)
    stand_in.points_max = 1
    start_plan(page)
    expect(page.locator("#mesh td.done")).to_have_count(1)
    stand_in.do(lambda: setattr(stand_in, "plan", None))
    shows(page, "#plan-none", "No plan has run")
    expect(page.locator("#mesh-box")).to_be_hidden()


def test_a_plan_with_targets_shows_its_precision_shrinking(server, visit: Watched):
    page = visit(server.urls.operator)
    take_command(page)
    stand_in = server.stand_in
    stand_in.points_max = 2
    start_plan(page)
    expect(page.locator("#plan-precision")).to_be_hidden()
    targets = {"alpha_percent": 0.1, "beta_A": 0.02}
    stand_in.do(lambda: stand_in.show_precision(targets, {"beta_A": 0.0345}))
    rows, bar = page.locator("#plan-precision tbody tr"), page.locator("#plan-precision .interval")
    expect(rows.nth(0)).to_contain_text("not known yet")
    expect(rows.nth(1)).to_contain_text("0.0345")
    expect(page.locator("#plan-time")).to_contain_text("at most")
    wide = float(bar.get_attribute("x2") or "")
    stand_in.do(lambda: stand_in.show_precision(targets, {"beta_A": 0.019}, "it does not fit"))
    shows(page, "#plan-precision", "Does not end early: it does not fit")
    expect(rows.nth(1)).to_contain_text("reached")
    assert float(bar.get_attribute("x2") or "") == pytest.approx(wide * 0.019 / 0.0345, rel=1e-6)


def test_a_plan_goes_through_the_queue(server, visit: Watched):
    page, viewer = visit(server.urls.operator), visit(server.urls.viewer)
    press(page, "#take")
    page.click("#plan-start-box > summary")
    page.fill("#plan-serial", HOSTILE)
    expect(page.locator("#plan-add")).to_be_disabled()
    press(page, "#plan-check")
    page.fill("#plan-wait", "winding below")
    press(page, "#plan-add")
    shows(page, "#messages", '"winding below" is no wait')
    page.fill("#plan-wait", "")
    page.fill("#plan-wait-limit", "90")
    press(page, "#plan-add")
    shows(page, "#messages", "nothing is waited for")
    page.fill("#plan-wait", "until 06:00; winding below 40")
    for number in "12":
        press(page, "#plan-add")
        shows(page, "#queue-items", f"{number} calibrate")
    press_by_key(page, "#queue-up-2")  # and the focus stays with the item
    waits(page, "() => document.activeElement.id === 'queue-down-2'")
    assert [row.get_attribute("data-id") for row in page.locator("#queue-items li").all()] == [
        *"21"
    ]
    shows(viewer, "#queue-items", HOSTILE)
    expect(viewer.locator("#queue button").first).to_be_hidden()
    press(page, "#queue-start")
    shows(page, "#queue-items li >> nth=0", "running")
    expect(page.locator("#queue-remove-2")).to_be_disabled()
    end = server.stand_in.queue.end
    server.stand_in.do(lambda: end("failed", "the speed was 3 % off"))
    shows(page, "#queue-items .attempts", "1 attempt; failed")
    press(page, "#queue-start")
    shows(page, "#queue-items li >> nth=0", "running")
    server.stand_in.do(lambda: end("done", recording="/runs/sim-7.mcap"))
    shows(viewer, "#queue-history li >> nth=0", "sim-7.mcap")
    page.dblclick("#queue-remove-1")
    shows(page, "#queue-state", "empty")
    assert names(server).count("queue/remove") == 1
    added = [given for name, given in server.stand_in.requests if name == "queue/add"]
    expected = [
        {"until": "06:00", "limit_s": 5400},
        {"channel": "winding", "below": 40, "limit_s": 5400},
    ]
    assert [one["plans"][0]["wait"] for one in added] == [expected, expected]
    waits(page, "() => document.activeElement.id === 'queue'")


@pytest.mark.parametrize("asked", [True, False])
def test_the_check_before_a_plan_can_be_left_out(asked: bool, serve: Serve, visit: Watched):
    stand_in = StandIn()
    stand_in.config["calibration"]["check_before_plans"] = asked
    server = serve(stand_in)
    page = visit(server.urls.operator)
    take_command(page)
    page.click("#plan-start-box > summary")
    box = page.locator("#plan-before-checked")
    if not asked:
        expect(box).to_be_hidden()
    press(page, "#plan-check")
    shows(page, "#plan-outline", "within the limits")
    if asked:
        box.uncheck()
        expect(page.locator("#plan-start")).to_be_disabled()  # until it is tried so
        press(page, "#plan-check")
        shows(page, "#plan-outline", "within the limits")
    press(page, "#plan-start")
    shows(page, "#plan-state", "running")
    sent = [given for name, given in stand_in.requests if name == "plan/start"]
    expected = [None, False, False] if asked else [None, None]
    assert [given.get("check") for given in sent] == expected


def test_a_plan_shows_its_progress_and_takes_no_point_when_it_was_stopped(server, visit: Watched):
    page = visit(server.urls.operator, NARROW)
    take_command(page)
    server.stand_in.points_max = 1
    start_plan(page)
    expect(page.locator("#plan-title")).to_be_in_viewport(ratio=1)
    assert page.locator("#plan").evaluate("e => e.scrollTop") == 0
    expect(page.locator("#mesh td.done")).to_have_count(1)
    expect(page.locator("#mesh td.now")).to_have_count(1)
    page.keyboard.press("Escape")
    shows(page, "#plan-state", "aborted")
    expect(page.locator("#mesh td.now")).to_have_count(0)
