"""The page of all benches: who comes, trips, falls silent and goes."""

import pytest
from playwright.sync_api import expect

from motord.api.messages import TripView
from motord.api.plan_messages import PlanView
from motord.client.benches import Benches
from motord.dashboard.app import application
from motord.dashboard.overview.bench_list import BenchList
from motord.dashboard.overview.overview_pages import BenchesLink, OverviewPages, command_for
from motord.dashboard.tokens import Tokens
from motord.security.roles import Role
from tests.browser.axe import AXE, findings
from tests.browser.chromium import DESKTOP, PHONE, needs_browser
from tests.browser.conftest import Watched
from tests.browser.stand_in import AppServer
from tests.support.played_benches import played, publishing

pytestmark = [pytest.mark.system, needs_browser]

HOSTILE = "<script>alert(1)</script>"


CUT_OFF = """(() => {
  const { scrollWidth, clientWidth } = document.querySelector("#summary");
  return scrollWidth > clientWidth;
})()"""


def test_benches_come_trip_fall_silent_and_vanish(visit: Watched):
    tokens = Tokens(Role.VIEWER)
    plan = PlanView(plan="calibrate", state="running", points=8, points_done=2, serial=HOSTILE)
    trip = TripView(name="OVER_CURRENT", meaning="a phase current was above the limit")
    tripped = {"state": "TRIPPED", "trips": [trip], "first_trip": "OVER_CURRENT", "plan": plan}
    with played("rig-1") as (first,), played("rig-2") as (second,):
        endpoints = [first.listen, second.listen]
        with Benches(endpoints) as benches:
            pages = OverviewPages(BenchList(command_for(None)), list)
            app = application(pages, tokens, BenchesLink(benches), "benches.html")
            with AppServer(app, tokens) as server, publishing(first, **tripped):
                page = visit(server.urls.viewer, PHONE, color_scheme="light")
                cards = page.locator(".bench")
                with publishing(second):
                    expect(cards).to_have_count(2)
                    expect(cards.nth(1)).to_contain_text("OFF")
                    expect(cards.nth(1)).to_have_attribute("data-old", "false")
                expect(cards.nth(1)).to_contain_text("silent for")
                expect(cards.nth(0)).to_contain_text("OVER_CURRENT: a phase current was above")
                expect(cards.nth(0)).to_contain_text("What to do: look at the phase currents")
                expect(cards.nth(0)).to_contain_text(HOSTILE)
                opens = f"motord dashboard --port 0 --bench rig-1 --connect {first.listen}"
                expect(cards.nth(0).locator("code")).to_have_text(opens)
                second.close()
                expect(cards.nth(1)).to_contain_text("vanished at")
                expect(page.locator("#summary")).to_have_text(
                    "1 bench: 1 tripped, 1 with a plan; 1 vanished"
                )
                for size in (DESKTOP, PHONE):
                    page.set_viewport_size(size)
                    assert page.evaluate(CUT_OFF) is False
                if AXE.exists():
                    page.evaluate(AXE.read_text())
                    assert findings(page) == [], "light"
                    page.emulate_media(color_scheme="dark")
                    assert findings(page) == [], "dark"
                assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
                visit.close()
