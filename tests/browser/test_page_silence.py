"""The page of a daemon, a loop or a server that is silent: nothing old counts as live."""

import pytest
from playwright.sync_api import expect

from tests.browser.chromium import (
    needs_browser,
    press,
    shows,
    take_command,
    waits,
)  # fmt: skip
from tests.browser.conftest import Watched
from tests.browser.stand_in import Server, StandIn
from tests.browser.stand_in_requests import commands

pytestmark = [pytest.mark.system, needs_browser]


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
