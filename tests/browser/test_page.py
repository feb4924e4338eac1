"""The page before a stand-in of the daemon: what it shows, what it sends, and what it does not."""

import base64
import json
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from motord.dashboard.frames import decode
from motord.dashboard.page.live_page import LivePage
from motord.dashboard.page.messages import ViewWanted
from tests.browser import documents
from tests.browser.chromium import (
    NARROW,
    PATH,
    PATIENCE_MS,
    PHONE,
    press,
    press_by_key,
    set_by_hand,
    shows,
    start_plan,
    take_command,
)  # fmt: skip
from tests.browser.conftest import Serve, Watched
from tests.browser.stand_in import Server, StandIn

AXE = Path(__file__).parents[1] / "node" / "node_modules" / "axe-core" / "axe.min.js"

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(not PATH, reason="needs a browser: apt-get install chromium"),
]


POLLING_MS = 100
HOSTILE = "<script>alert(1)</script>"


def names(server: Server) -> list[str]:
    """Return the requests that the daemon got, but for those that renew."""
    return [name for name, _ in server.stand_in.requests if name != "lease/renew"]


def commands(server: Server) -> list[str]:
    """Return those that move something."""
    return [name for name in names(server) if name in ("enable", "set", "plan/start", "stop")]


def waits(page: Page, condition: str, argument: Any = None) -> None:
    """Wait until a condition in JavaScript holds, without a frame for each look."""
    page.wait_for_function(condition, arg=argument, polling=POLLING_MS, timeout=PATIENCE_MS)


def until(page: Page, condition: Callable[[], bool]) -> None:
    """Wait until a condition holds, while the page goes on."""
    end_s = time.monotonic() + PATIENCE_MS / 1000
    while not condition():
        assert time.monotonic() < end_s
        page.wait_for_timeout(20)


def test_a_person_operates_by_hand(server, visit: Watched):
    page = visit(server.urls.operator)
    assert "token" not in page.url
    shows(page, "#state-name", "OFF")
    expect(page.locator("#torque-set")).to_be_disabled()
    take_command(page)
    page.fill("#torque-slider", "3")
    assert page.input_value("#torque") == "3"
    assert "set" not in names(server)  # a slider that was moved has sent nothing
    set_by_hand(page, 2.5, 0.7)
    shows(page, "#setpoint-now", "2.50")
    waits(page, f"() => Math.abs(parseFloat({FIRST_VALUE}) - 2.5) < 0.5")
    shows(page, "#turns-caption", "p-p about 2.50")
    page.fill("#torque", "7")
    page.press("#torque", "Enter")
    sent = [given for name, given in server.stand_in.requests if name == "set"]
    assert [given["torque_Nm"] for given in sent if "torque_Nm" in given] == [2.5]
    press(page, "#zero")
    shows(page, "#setpoint-now", "0.00")
    press(page, "#take")
    shows(page, "#lease-text", "Nobody is in command")
    shows(page, "#state-name", "READY")


def test_stop_by_key_says_stopped_when_the_daemon_has_reported_it(server, visit: Watched):
    page = visit(server.urls.operator)
    take_command(page)
    page.focus("#note")
    page.keyboard.press("Escape")
    shows(page, "#stop-status", "Stopped: the daemon reports OFF")
    shows(page, "#state-name", "OFF")
    assert "stop" in names(server)
    press(page, "#enable")
    shows(page, "#state-name", "ENABLED")
    server.stand_in.do(lambda: setattr(server.stand_in, "silent", True))
    press(page, "#stop")
    shows(page, "#stop-status", "NOT STOPPED by this page")
    expect(page.locator("#state-name")).to_have_text("ENABLED")
    expect(page.locator("body")).to_have_attribute("data-stale", "true")


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


def test_a_spike_of_one_tick_at_10_kHz_shows_in_a_minute(serve: Serve, visit: Watched):
    server = serve(StandIn(10_000.0))
    page = visit(server.urls.operator)
    page.select_option("#span", "60")
    waits(page, TALLEST + "> 0; }")
    server.stand_in.do(lambda: setattr(server.stand_in.bench, "spike_Nm", 8.0))
    page.wait_for_function(TALLEST + "> 0.45 * height; }", polling=500, timeout=PATIENCE_MS)


FIRST_VALUE = "document.querySelector('.value').textContent"
CURSORS = "[...document.querySelectorAll('.u-cursor-x')].map((e) => e.style.transform)"
TALLEST = """() => {
  const shown = document.querySelector('.plot .traces');
  const [width, height] = [shown.width, shown.height];
  const canvas = new OffscreenCanvas(width, height);
  canvas.getContext('2d', { willReadFrequently: true }).drawImage(shown, 0, 0);
  const ink = getComputedStyle(document.querySelector('.trace-row .tag')).color.match(/\\d+/g);
  const data = canvas.getContext('2d').getImageData(0, 0, width, height).data;
  let tallest = 0;
  for (let x = 0; x < width; x++) {
    let [first, last] = [height, 0];
    for (let y = 0; y < height; y++) {
      const at = 4 * (y * width + x);
      const off = [0, 1, 2].map((k) => Math.abs(data[at + k] - ink[k])).reduce((a, b) => a + b);
      if (data[at + 3] > 100 && off < 40) { first = Math.min(first, y); last = y; }
    }
    tallest = Math.max(tallest, last - first);
  }
  return tallest """


def test_pause_zoom_and_cursor(server, visit: Watched):
    page = visit(server.urls.operator)
    waits(page, TALLEST + "> 0; }")
    page.click("#pause-traces")
    shows(page, "#held", "held at")
    held = page.locator("#held").inner_text()
    box = page.locator(".plot").nth(0).bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] - 30, box["y"] + 40
    page.mouse.move(x, y)
    shows(page, "#cursor-time", ":")
    waits(page, f"() => {CURSORS}.length === 4 && new Set({CURSORS}).size === 1")  # one time in all
    page.mouse.move(x - 100, y)
    page.mouse.down()
    page.mouse.move(x - 20, y, steps=3)
    waits(page, "() => document.querySelector('.u-select').offsetWidth > 60")
    page.mouse.up()
    waits(page, "() => !document.querySelector('#span-other').hidden")
    assert page.locator("#held").inner_text() != ""
    page.mouse.wheel(0, 100)
    page.focus("#plots")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("-")
    page.keyboard.press("PageUp")
    waits(page, "held => document.querySelector('#held').textContent !== held", held)
    page.keyboard.press("End")
    expect(page.locator("#held")).to_have_text("")
    page.select_option("#span", "10")
    page.focus("#plots")
    page.keyboard.press("-")
    expect(page.locator("#span")).to_have_value("20")


def test_the_list_of_signals_closes_by_a_press_and_a_focus_elsewhere(server, visit: Watched):
    page = visit(server.urls.operator)
    waits(page, TALLEST + "> 0; }")
    choice, signals = page.locator("#signal-choice"), page.locator("#signals summary")
    box = choice.locator("input").first
    signals.click()
    box.click()
    choice.locator("legend").first.click()  # what takes no focus
    expect(choice).to_be_visible()
    page.click("#traces-title")
    expect(choice).to_be_hidden()
    signals.click()
    choice.locator("input").last.focus()
    expect(choice).to_be_visible()
    page.keyboard.press("Tab")
    expect(choice).to_be_hidden()
    signals.click()
    signals.click()
    expect(choice).to_be_hidden()


def test_a_selection_outlives_another_size(server, visit: Watched):
    page = visit(server.urls.operator)
    waits(page, TALLEST + "> 0; }")
    page.click("#pause-traces")
    box = page.locator(".plot").nth(0).bounding_box()
    assert box is not None
    x, y = box["x"] + 100, box["y"] + 40
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 80, y, steps=3)
    waits(page, "() => document.querySelector('.u-select').offsetWidth > 60")
    page.evaluate("() => { window.before = document.querySelector('canvas.traces'); }")
    page.evaluate("() => { document.querySelector('#plots').style.paddingRight = '40px'; }")
    waits(page, "() => document.querySelector('canvas.traces') !== window.before")
    waits(page, TALLEST + "> 0; }")
    page.mouse.move(x + 90, y)
    waits(page, "() => document.querySelector('.u-select').offsetWidth > 60")
    page.mouse.up()
    waits(page, "() => !document.querySelector('#span-other').hidden")


def test_a_note_is_a_mark(server, visit: Watched):
    page = visit(server.urls.operator)
    page.locator("h1").click()
    page.keyboard.press("n")
    page.keyboard.type("bearing is warm, n")
    page.keyboard.press("Enter")
    shows(page, "#event-list", "bearing is warm, n")
    shows(page, "#messages", "Noted, in the recording")
    noted = [given["text"] for name, given in server.stand_in.requests if name == "note"]
    assert noted == ["bearing is warm, n"]


def test_a_trip_says_what_to_do(server, visit: Watched):
    page = visit(server.urls.operator)
    take_command(page)
    server.stand_in.do(server.stand_in.trip_over_current)
    shows(page, "#state-name", "TRIPPED")
    for text in ("OVER_CURRENT", "41.3 A, limit 40.0 A", "look for a short", "Black box"):
        shows(page, "#trip", text)
    press(page, "#reset")
    shows(page, "#state-name", "READY")
    expect(page.locator("#trip")).to_be_hidden()


def test_a_bridge_board_that_is_barred_no_more_is_not_shown_as_barred(server, visit: Watched):
    page = visit(server.urls.viewer)
    stand_in = server.stand_in
    press(page, "#tab-health")
    stand_in.do(lambda: setattr(stand_in, "barred", "end the other host"))
    shows(page, "#health-figures", "end the other host")
    stand_in.do(lambda: setattr(stand_in, "barred", ""))
    expect(page.locator("#health-figures")).not_to_contain_text("Bridge board")
    shows(page, "#health-figures", "Link errors")


def test_a_recording_that_may_not_go_on_says_why(server, visit: Watched):
    page = visit(server.urls.operator)
    take_command(page)
    start_plan(page)
    press(page, "#tab-health")
    shows(page, "#health-figures", "calibrate-000.mcap")
    server.stand_in.do(lambda: setattr(server.stand_in, "unreported", "no report for 8 s"))
    shows(page, "#health-figures", " MB: no report for 8 s")  # next to the file
    press(page, "#tab-page")
    shows(page, "#trouble", "Recording: no report for 8 s")
    server.stand_in.do(lambda: setattr(server.stand_in, "unreported", ""))
    expect(page.locator("#trouble")).to_be_hidden()


NOTE_DRAWN_TEXTS = """() => {
  window.drawn = [];
  const {prototype} = CanvasRenderingContext2D, fillText = prototype.fillText;
  prototype.fillText = function (text, ...at) {
    window.drawn.push(text);
    fillText.call(this, text, ...at);
  };
}"""


def test_traces_of_a_loop_that_ended_or_whose_ticks_do_not_arrive_are_not_live(
    server, visit: Watched
):
    page = visit(server.urls.operator)
    press(page, "#take")
    shows(page, "#lease-text", "You are in command")
    expect(page.locator("#enable")).to_be_enabled()
    waits(page, "() => document.body.dataset.ticksStale === undefined")
    page.evaluate(NOTE_DRAWN_TEXTS)
    server.stand_in.do(lambda: setattr(server.stand_in, "loop_ended", True))
    shows(page, "#no-ticks", "no ticks come from the loop")
    expect(page.locator("body")).not_to_have_attribute("data-stale", "true")  # the state is live
    expect(page.locator("#enable")).to_be_disabled()
    expect(page.locator("#reset")).to_be_enabled()
    pale = page.locator("#plots canvas").first
    assert float(pale.evaluate("e => getComputedStyle(e).opacity")) < 0.6
    waits(page, "() => window.drawn.includes('last')")  # in the place of "now"
    server.stand_in.do(lambda: setattr(server.stand_in, "loop_ended", False))
    expect(page.locator("#no-ticks")).to_be_empty()
    page.evaluate("() => { window.drawn = []; }")
    server.stand_in.do(lambda: setattr(server.stand_in, "ticks_withheld", True))
    shows(page, "#no-ticks", "no ticks arrive from the daemon")
    expect(page.locator("body")).not_to_have_attribute("data-stale", "true")
    waits(page, "() => window.drawn.includes('last')")
    server.stand_in.do(lambda: setattr(server.stand_in, "ticks_withheld", False))
    expect(page.locator("#no-ticks")).to_be_empty()


def test_a_reload_keeps_the_token_and_says_how_long_the_daemon_was_silent(server, visit: Watched):
    stand_in = server.stand_in
    page = visit(server.urls.operator.replace("#token=", "?token="))
    assert "token" not in page.url
    stand_in.do(lambda: stand_in.fall_silent(3600.0))
    page.reload()
    shows(page, "#gone", "publishes nothing")
    stand_in.do(lambda: setattr(stand_in, "silent", False))
    shows(page, "#messages", "The daemon publishes again, after 1:0")  # hour
    shows(page, "#link-text", "live")


def test_what_is_old_invites_nobody_to_enable(server, visit: Watched):
    page = visit(server.urls.operator)
    press(page, "#take")
    shows(page, "#state-meaning", "You may enable it.")
    server.stand_in.do(lambda: setattr(server.stand_in, "silent", True))
    expect(page.locator("#state-meaning")).not_to_contain_text("You may enable it.")


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


def test_what_is_silent_is_grey_and_commands_nothing(server, visit: Watched):
    page = visit(server.urls.operator)
    take_command(page)
    stand_in = server.stand_in
    stand_in.do(lambda: setattr(stand_in, "silent", True))
    expect(page.locator("body")).to_have_attribute("data-stale", "true")
    pale = page.locator("#plots canvas").first
    assert float(pale.evaluate("e => getComputedStyle(e).opacity")) < 0.6
    shows(page, "#link-text", "publishes nothing")
    before = commands(server)
    stand_in.do(lambda: (setattr(stand_in, "silent", False), stand_in.restart()))
    shows(page, "#messages", "The daemon was restarted")
    shows(page, "#link-text", "live")
    shows(page, "#lease-text", "Nobody is in command")
    assert commands(server) == before


NOTE_WHAT_COSTS = """() => {
  window.costs = { frames: 0, drawn: 0, same: [] };
  const { requestAnimationFrame } = window, { prototype } = CanvasRenderingContext2D;
  const { putImageData } = prototype;
  window.requestAnimationFrame = (drawing) => {
    costs.frames += 1;
    return requestAnimationFrame(drawing);
  };
  prototype.putImageData = function (...what) {
    costs.drawn += this.canvas === document.querySelector('canvas.traces');
    putImageData.apply(this, what);
  };
  new MutationObserver((changes) => {
    for (const { target, oldValue } of changes)
      if (target.getAttribute('hidden') === oldValue) costs.same.push(target.id);
  }).observe(document, { subtree: true, attributeFilter: ['hidden'], attributeOldValue: true });
}"""


NARROWER_AND_FITTED = """() => {
  document.querySelector('#plots').style.width = '60%';
  document.querySelector('#theme').dispatchEvent(new Event('change'));
}"""
"""Traces that come do so, too: a size is noticed only a while after the last one."""


def test_a_page_of_a_bench_at_rest_costs_little_and_reports_lost_ticks_alone(
    server, visit: Watched, monkeypatch
):
    asked, look_at = [], LivePage._look_at

    def note(page: LivePage, wanted: ViewWanted) -> None:
        asked.append((page, wanted))
        look_at(page, wanted)

    monkeypatch.setattr(LivePage, "_look_at", note)
    page = visit(server.urls.operator)
    page.emulate_media(reduced_motion="reduce")
    press(page, "#tab-health")
    shows(page, "#health-figures", "Link errors")
    expect(page.locator("#gone")).to_be_hidden()
    assert page.locator("#messages").inner_text() == ""
    press(page, "#tab-page")  # the chart of health has frames of its own
    page.evaluate("() => { window.before = document.querySelector('canvas.traces'); }")
    page.evaluate("() => { document.querySelector('#plots').style.paddingBottom = '40px'; }")
    waits(page, "() => document.querySelector('canvas.traces') !== window.before")
    page.evaluate(NOTE_WHAT_COSTS)
    page.select_option("#span", "30")
    waits(page, "() => costs.drawn >= 6")
    costs = page.evaluate("costs")
    assert asked
    assert all(one != next_one for one, next_one in pairwise(asked))  # a height is no other width
    assert costs["same"] == []  # what stays is not assigned again
    assert costs["frames"] <= 4 * costs["drawn"]  # and it does not wait frame by frame
    page.evaluate(NARROWER_AND_FITTED)
    until(page, lambda: asked[-1][1].buckets < asked[0][1].buckets)
    bench = server.stand_in.bench
    server.stand_in.do(lambda: setattr(bench, "tick", bench.tick + 250))
    shows(page, "#lost", "250 ticks lost")


def test_two_operators(server, visit: Watched):
    first, second = visit(server.urls.operator), visit(server.urls.operator)
    take_command(first)
    shows(second, "#lease-text", "page 1 is in command")
    expect(second.locator("#enable")).to_be_disabled()
    press(second, "#take")
    shows(second, "#take-over-text", "would lose it at once")
    press(second, "#cancel-take")
    expect(second.locator("#take-over")).to_be_hidden()
    shows(first, "#lease-text", "You are in command")
    press(second, "#take")
    press(second, "#confirm-take")
    shows(second, "#lease-text", "You are in command")
    shows(first, "#lease-text", "page 2 is in command")
    shows(first, "#lease-why", "Lost:")
    expect(first.locator("#disable")).to_be_disabled()


def test_a_viewer_looks(server, visit: Watched):
    page = visit(server.urls.viewer)
    shows(page, "#viewer-note", "may look, not command")
    expect(page.locator("#enable")).to_be_hidden()
    page.keyboard.press("Escape")
    shows(page, "#stop-status", "A viewer's page cannot stop")
    assert commands(server) == []


def test_who_is_not_let_in_gets_the_reason_and_no_claims(server, visit: Watched):
    visit.expected = "401"
    address = server.urls.operator.split("#")[0]
    page = visit(address, live=False)
    shows(page, "#refused-text", "This page has no token")
    page.goto(f"{address}?token=wrong-wrong-wrong-wrong")
    shows(page, "#refused-text", "not, or no longer, that of the server")
    assert "token" not in page.url
    shows(page, "#lease-text", "Not known who is in command")
    for claim in ("#plan-none", "#calibration-empty"):
        expect(page.locator(claim)).to_be_hidden()
    assert commands(server) == []


def test_a_server_that_comes_back_finds_the_page_again(visit: Watched):
    visit.expected = "ERR_CONNECTION_REFUSED"
    stand_in = StandIn()
    with Server(stand_in) as first:
        page = visit(first.urls.operator)
        take_command(page)
    shows(page, "#link-text", "no connection")
    page.keyboard.press("Escape")
    shows(page, "#stop-status", "NOT SENT")
    before = list(stand_in.requests)
    with Server(stand_in, first.port, tokens=first.tokens) as second:
        shows(page, "#link-text", "live")
        shows(page, "#messages", "Connected again")
        assert commands(second) == commands(first)
        after = {name for name, _ in stand_in.requests[len(before) :]}
        assert not after & {"set", "stop", "enable", "lease/acquire"}


def test_a_hidden_page_gets_no_traces(server, visit: Watched):
    page = visit(server.urls.operator)
    page.evaluate(HIDE, True)
    frames: list[str] = []
    cdp = page.context.new_cdp_session(page)
    cdp.on("Network.webSocketFrameReceived", lambda got: frames.append(kind_of(got)))
    cdp.send("Network.enable")
    received(page, frames, "state", 2)  # what was under way has come
    frames.clear()
    received(page, frames, "state", 4)  # the socket is still there
    assert not {"trace", "turns", "timing"} & set(frames)
    page.evaluate(HIDE, False)
    received(page, frames, "trace", 1)
    cdp.detach()  # the page is that of the next test as well


def received(page: Page, frames: list[str], kind: str, count: int) -> None:
    """Wait until so many frames of a kind have come."""
    until(page, lambda: frames.count(kind) >= count)


def kind_of(received: dict[str, Any]) -> str:
    """Return the kind of a frame that the debugger reports."""
    header, _ = decode(base64.b64decode(received["response"]["payloadData"]))
    return str(header["kind"])


HIDE = """hidden => {
  Object.defineProperty(document, 'hidden', { value: hidden, configurable: true });
  document.dispatchEvent(new Event('visibilitychange'));
}"""


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


def test_findings_of_the_calibration_chosen_are_listed_though_another_comes_late(
    server, visit: Watched
):
    page = visit(server.urls.operator)
    page.click("#tab-calibration")
    listed = page.locator("#calibration-content .findings li")
    expect(listed).to_have_count(2)
    expect(listed.first).to_contain_text("Serious: encoder-error-order-1 0.284 deg (limit 0.0123)")
    expect(listed.first).to_contain_text("Centre the encoder")
    expect(listed.last).to_contain_text("Warning: current-age 131 us (limit 100)")
    page.select_option("#calibration-choice", documents.IDS[1])
    shows(page, "#calibration-content", "Earlier, not in force")
    expect(listed).to_have_count(0)
    page.select_option("#calibration-choice", documents.IDS[0])
    shows(page, "#calibration-content", "In force")
    chosen, late = documents.IDS
    server.stand_in.held_back.add(late)
    page.select_option("#calibration-choice", late)
    until(page, lambda: late in server.stand_in.waited_for)
    page.select_option("#calibration-choice", chosen)
    shows(page, "#calibration-content", "In force")
    server.stand_in.held_back.clear()
    until(page, lambda: late in server.stand_in.given_late)
    page.fill("#note", "the late answer is here by now")
    page.keyboard.press("Enter")
    shows(page, "#messages", "Noted")
    shows(page, "#calibration-content", "In force")


def test_what_is_tracked_stands_against_the_calibration_in_force(server, visit: Watched):
    page = visit(server.urls.operator)
    page.click("#tab-calibration")
    shows(page, "#calibration-content", "In force")
    expect(page.locator("#calibration-tracked")).to_be_hidden()
    server.stand_in.tracking = documents.tracking()
    shows(
        page, "#tracked-verdict", "Tracked over 70 turns: all 3 quantities within their intervals"
    )
    page.click("#tracked-verdict")
    shows(page, "#tracked-quantities", "not seen: the common offset of the currents")
    server.stand_in.tracking = documents.tracking("b")
    shows(page, "#tracked-verdict", "alpha-b left its interval. motord calibration adopt takes")
    departed = page.locator("#calibration-tracked .departed")
    expect(departed).to_have_count(1)
    expect(departed).to_contain_text("alpha-b")
    expect(departed).to_contain_text("1.0213 \u00b1 0.0042")
    server.stand_in.tracking = {**documents.tracking("c"), "t_ns": 9}
    shows(page, "#tracked-verdict", "alpha-c left its interval. Calibrate again")
    server.stand_in.tracking = None
    expect(page.locator("#calibration-tracked")).to_be_hidden()


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


def findings(page: Page, part: str = "html") -> list[str]:
    """Return what axe-core finds serious or critical in a part of the page."""
    result = page.evaluate("part => axe.run(part, {resultTypes: ['violations']})", part)
    return [
        f"{one['id']}: {json.dumps([node['target'] for node in one['nodes']])}"
        for one in result["violations"]
        if one["impact"] in ("serious", "critical")
    ]
