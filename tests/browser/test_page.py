"""The page before a stand-in of the daemon: what it shows, what it sends, and what it does not."""

import pytest
from playwright.sync_api import expect

from tests.browser import documents
from tests.browser.chromium import (
    needs_browser,
    press,
    set_by_hand,
    shows,
    start_plan,
    take_command,
    until,
    waits,
)  # fmt: skip
from tests.browser.conftest import Serve, Watched
from tests.browser.stand_in import StandIn
from tests.browser.stand_in_requests import commands, names

pytestmark = [pytest.mark.system, needs_browser]


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


def test_a_person_turns_it_backwards(server, visit: Watched):
    page = visit(server.urls.operator)
    take_command(page)
    set_by_hand(page, -1.0, -0.7)
    until(page, lambda: names(server).count("set") == 2)
    speed, torque = [given for name, given in server.stand_in.requests if name == "set"]
    assert (speed["speed_Hz"], torque["torque_Nm"]) == (-0.7, -1.0)


def test_a_small_motor_is_set_by_the_slider_and_its_torque_is_to_be_read(
    serve: Serve, visit: Watched
):
    stand_in = StandIn()
    stand_in.config["limits"]["torque_Nm"] = 0.03
    page = visit(serve(stand_in).urls.operator)
    take_command(page)
    shows(page, "#torque-high", "+0.03 Nm")
    page.fill("#torque-slider", "0.01")
    page.press("#torque-slider", "Enter")
    shows(page, "#setpoint-now", "0.0100")


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


FIRST_VALUE = "document.querySelector('.value').textContent"


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


def test_the_list_of_keys_shows_whatever_tab_is_open(server, visit: Watched):
    page = visit(server.urls.viewer)
    page.click("#tab-health")
    for _ in range(2):
        page.keyboard.press("?")
        expect(page.locator("#keys-help")).to_contain_text("STOP, from anywhere")
        expect(page.locator("#keys-help dl")).to_be_visible()


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


def test_calibrations_are_listed_with_their_time_and_none_is_said_to_be_none(
    server, visit: Watched
):
    stand_in, empty = server.stand_in, "#calibration-empty"
    calibrations, stand_in.calibrations = stand_in.calibrations, []
    stand_in.unanswered.add("calibration/list")
    page = visit(server.urls.operator)
    shows(page, empty, "Not known: no answer in time")
    stand_in.do(stand_in.unanswered.clear)
    shows(page, empty, "No calibration is installed")
    stand_in.calibrations = calibrations
    page.reload()
    expect(page.locator("#calibration-choice option")).to_have_text(
        [
            f"2026-01-01 09:00 UTC joint {documents.IDS[0][:8]} (in force)",
            f"2025-12-01 15:30 UTC residual {documents.IDS[1][:8]}",
        ]
    )


def test_what_a_calibration_brought_has_its_interval_or_says_that_it_is_not_known(
    server, visit: Watched
):
    page = visit(server.urls.viewer)
    page.click("#tab-calibration")
    shows(
        page, "#calibration-content",
        "RMS error: before 3.10 %, interval not known (worst 4.20 %, interval not known), "
        "after 0.380 \u00b1 0.030 % (worst 0.610 \u00b1 0.050 %)",
    )  # fmt: skip


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
