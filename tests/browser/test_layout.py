"""Where the parts of the page are, whatever they say; what is not known is not claimed."""

import pytest
from playwright.sync_api import FloatRect, Locator, expect

from tests.browser import documents
from tests.browser.chromium import (
    NARROW,
    PHONE,
    needs_browser,
    press,
    set_by_hand,
    shows,
    take_command,
)  # fmt: skip
from tests.browser.conftest import Watched
from tests.browser.stand_in import Server, StandIn

pytestmark = [pytest.mark.system, needs_browser]
SMALL_PHONE = {"width": 375, "height": 800}
LAPTOP = {"width": 1280, "height": 800}
CHART_HEIGHT_px = 90
"""With less of it a chart shows nothing any more."""
LINE_px = 16
LONG = "axial-flux 48/16, laboratory prototype number 2 with the wound stator of the year before"


def inside(inner: Locator, outer: Locator) -> bool:
    """Return whether an element and all of its text are within another one."""
    found = [
        element.evaluate("e => e.getBoundingClientRect().toJSON()") for element in (inner, outer)
    ]
    part, whole = found
    return bool(
        part["left"] >= whole["left"]
        and part["right"] <= whole["right"]
        and part["top"] >= whole["top"]
        and part["bottom"] <= whole["bottom"]
    )


def test_a_long_name_takes_no_room_from_state_lease_and_stop(
    server: Server, visit: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = documents.state
    monkeypatch.setattr(documents, "state", lambda *given: {**plain(*given), "motor": LONG})
    page = visit(server.urls.operator, PHONE)
    shows(page, "#motor", LONG)
    take_command(page)
    for size in (PHONE, NARROW):
        page.set_viewport_size(size)
        for part, whole in (
            ("#state-name", "#state"), ("#state-meaning", "#state"), ("#take", "#lease"),
            ("#lease-text", "#lease"), ("#lease-why", "#lease"), ("#motor", "#identity"),
            ("#stop-label", "#stop"),
        ):  # fmt: skip
            assert inside(page.locator(part), page.locator(whole)), (part, size)
        assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]


def test_on_a_phone_state_and_stop_stay_alone_however_much_stands_above_them(
    server: Server, visit: Watched
) -> None:
    page = visit(server.urls.operator, PHONE)
    server.stand_in.do(lambda: setattr(server.stand_in, "silent", True))
    shows(page, "#link", "last state")
    page.evaluate("window.scrollTo(0, 900)")
    for part in ("#state", "#stop"):
        expect(page.locator(part)).to_be_in_viewport(ratio=1)
    assert page.locator("#lease").evaluate("e => e.getBoundingClientRect().bottom") <= 1
    assert page.locator("#link").evaluate("e => e.getBoundingClientRect().bottom") <= 1


def test_a_phone_shows_how_old_the_last_state_is_without_a_connection(visit: Watched) -> None:
    visit.expected = "ERR_CONNECTION_REFUSED"
    with Server(StandIn()) as server:
        page = visit(server.urls.operator, PHONE)
    shows(page, "#link-text", "the page's server does not answer")
    shows(page, "#link-age", " ago")
    for size in (PHONE, SMALL_PHONE):
        page.set_viewport_size(size)
        assert inside(page.locator("#link-age"), page.locator("#link")), size


def test_stop_and_the_controls_stay_where_they_are_whatever_goes_wrong(
    server: Server, visit: Watched
) -> None:
    page = visit(server.urls.operator, NARROW)
    stand_in = server.stand_in

    def boxes() -> list[tuple[FloatRect, FloatRect]]:
        """Return where both are in pages of three sizes, the smallest at last."""
        found = []
        for size in (NARROW, {"width": 1000, "height": 900}, PHONE):
            page.set_viewport_size(size)
            stop = page.locator("#stop").bounding_box()
            controls = page.locator("#operate").bounding_box()
            assert stop is not None
            assert controls is not None
            found.append((stop, controls))
        return found

    before = boxes()

    def stays() -> None:
        for (now, controls_now), (then, controls_then) in zip(boxes(), before, strict=True):
            assert (now["x"], now["y"], now["width"]) == (then["x"], then["y"], then["width"])
            assert now["height"] >= then["height"]
            assert abs(controls_now["y"] - controls_then["y"]) < LINE_px

    take_command(page)
    stand_in.do(lambda: setattr(stand_in, "unreported", "no report for 8 s"))
    stand_in.do(stand_in.trip_over_current)
    shows(page, "#trip", "What to do")
    stays()
    stand_in.do(lambda: setattr(stand_in, "loop_ended", True))
    shows(page, "#no-ticks", "no ticks come from the loop")
    stays()
    stand_in.do(lambda: stand_in._end_lease("was taken over, " + LONG))
    shows(page, "#lease-why", "Lost: ")
    shows(page, "#messages", f"in command. {page.locator('#lease-why').text_content()}")
    stays()
    stand_in.do(lambda: setattr(stand_in, "silent", True))
    shows(page, "#gone", "publishes nothing")
    stays()


def test_a_phone_says_at_its_head_what_is_wrong(server: Server, visit: Watched) -> None:
    page = visit(server.urls.operator, PHONE)
    line = page.locator("#alert-line")
    take_command(page)
    expect(line).to_be_hidden()
    stand_in = server.stand_in
    stand_in.do(lambda: setattr(stand_in, "unreported", "no report for 8 s"))
    expect(line).to_have_text("Recording: no report for 8 s")
    expect(line).to_be_in_viewport(ratio=1)
    page.evaluate("window.scrollTo(0, 2000)")
    expect(line).to_be_in_viewport(ratio=1)
    line.click()
    expect(page.locator("#trouble")).to_be_in_viewport(ratio=1)
    stand_in.do(lambda: setattr(stand_in, "silent", True))
    press(page, "#stop")
    shows(page, "#alert-line", "NOT STOPPED by this page")
    page.set_viewport_size(NARROW)
    expect(line).to_be_hidden()  # all of it stands above the traces
    expect(page.locator("#stop-status")).to_be_in_viewport(ratio=1)


def test_what_a_state_means_takes_no_room_from_the_controls(
    server: Server, visit: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain, changes = documents.state, {"fault": "the loop ended"}
    monkeypatch.setattr(documents, "state", lambda *given: {**plain(*given), **changes})
    page = visit(server.urls.operator)
    sizes = (PHONE, {"width": 1000, "height": 900}, LAPTOP)

    def tops_px(shown: bool) -> list[float]:
        """Return where the controls begin in pages of all sizes, which show the whole or do not."""
        found = []
        for size in sizes:
            page.set_viewport_size(size)
            expect(page.locator("#state-all")).to_be_visible(visible=shown)
            box = page.locator("#operate").bounding_box()
            assert box is not None
            found.append(box["y"])
        return found

    shows(page, "#state-meaning", "the loop ended")
    before = tops_px(shown=False)
    server.stand_in.do(lambda: changes.update(fault=f"the loop ended: {LONG}; {LONG}; end"))
    shows(page, "#state-all", "the loop ended: ")
    shows(page, "#state-all", "; end")
    for size, now, then in zip(sizes, tops_px(shown=True), before, strict=True):
        assert abs(now - then) < LINE_px, size
    tripped = {"state": "TRIPPED", "fault": f"the brake is silent: {LONG}; {LONG}; over"}
    server.stand_in.do(lambda: changes.update(tripped))
    shows(page, "#state-all", "; over")  # of that the trip says nothing
    server.stand_in.do(lambda: changes.update(fault="the loop ended"))
    tops_px(shown=False)


def test_why_the_daemon_is_silent_takes_no_room_from_the_head(
    server: Server, visit: Watched
) -> None:
    why = "the daemon of bench 'browser' at tcp/127.0.0.1:29825 publishes nothing; no motord there"
    page = visit(server.urls.operator, NARROW)
    height_px = page.locator("header").evaluate("e => e.clientHeight")
    server.stand_in.why_silent = f"{why} for bench 'browser': is `motord run` running there?"
    server.stand_in.do(lambda: setattr(server.stand_in, "silent", True))
    shows(page, "#gone", "is `motord run` running there?")
    grown_px = page.locator("header").evaluate("e => e.clientHeight") - height_px
    assert grown_px < LINE_px
    assert inside(page.locator("#link-text"), page.locator("#link"))
    server.stand_in.do(lambda: setattr(server.stand_in, "silent", False))
    expect(page.locator("#gone")).to_be_hidden()
    shows(page, "#messages", "The daemon publishes again, after ")


def test_without_a_calibration_it_says_so(
    server: Server, visit: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = documents.state
    monkeypatch.setattr(documents, "calibrations", list)
    monkeypatch.setattr(documents, "state", lambda *given: {**plain(*given), "calibration": None})
    page = visit(server.urls.operator)
    shows(page, "#calibration-empty", "No calibration is installed")
    shows(page, "#plan-none", "No plan has run")


def test_what_the_charts_of_the_turn_say_is_whole_and_has_its_unit(
    server: Server, visit: Watched
) -> None:
    page = visit(server.urls.operator)
    take_command(page)
    set_by_hand(page, 2.5, 0.7)
    shows(page, "#turns-caption", "about 2.50 Nm")
    shows(page, "#orders-caption", "calibrated")
    for size in (SMALL_PHONE, NARROW, LAPTOP):
        page.set_viewport_size(size)
        for caption in page.locator("#turns figcaption").all():
            expect(caption.locator(".unit")).to_have_text("Nm")
            assert caption.evaluate("e => e.scrollWidth <= e.clientWidth"), caption.inner_text()
        for chart in page.locator("#turns .chart").all():
            assert chart.evaluate("e => e.clientHeight") >= CHART_HEIGHT_px, size


def test_what_a_field_asks_for_can_be_read_and_the_scale_of_the_torque_stays_small(
    server: Server, visit: Watched
) -> None:
    page = visit(server.urls.operator)
    for field in page.locator("[placeholder]").all():
        assert placeholder_px(field) <= field.evaluate(ROOM)
    page.set_viewport_size({"width": 1000, "height": 900})  # one wide column
    assert page.locator("#ramp").evaluate("e => e.getBoundingClientRect().height") < 50


ROOM = """e => {
  const style = getComputedStyle(e);
  return e.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
}"""


def placeholder_px(field: Locator) -> float:
    """Return how wide the placeholder of a field is."""
    return float(
        field.evaluate("""e => {
          const context = document.createElement("canvas").getContext("2d");
          const { fontSize, fontFamily } = getComputedStyle(e);
          context.font = `${fontSize} ${fontFamily}`;
          return context.measureText(e.placeholder).width;
        }""")
    )
