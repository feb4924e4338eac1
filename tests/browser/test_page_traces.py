"""Traces on the page: what they show, where they look, and what they cost."""

import base64
from itertools import pairwise
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from motord.dashboard.frames import decode
from motord.dashboard.page.live_page import LivePage
from motord.dashboard.page.messages import ViewWanted
from tests.browser.chromium import (
    PATIENCE_MS,
    needs_browser,
    press,
    shows,
    until,
    waits,
)  # fmt: skip
from tests.browser.conftest import Serve, Watched
from tests.browser.stand_in import StandIn

pytestmark = [pytest.mark.system, needs_browser]


def test_a_spike_of_one_tick_at_10_kHz_shows_in_a_minute(serve: Serve, visit: Watched):
    server = serve(StandIn(10_000.0))
    page = visit(server.urls.operator)
    page.select_option("#span", "60")
    waits(page, TALLEST + "> 0; }")
    server.stand_in.do(lambda: setattr(server.stand_in.bench, "spike_Nm", 8.0))
    page.wait_for_function(TALLEST + "> 0.45 * height; }", polling=500, timeout=PATIENCE_MS)


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
    expect(page.locator("#messages .error")).to_have_count(0)
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
