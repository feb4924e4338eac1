"""A browser that dies fails the test it dies in, and no other."""

from contextlib import suppress

import pytest
from playwright.sync_api import Error, Playwright

from tests.browser.chromium import needs_browser
from tests.browser.conftest import LiveBrowser, Serve, Watched
from tests.browser.stand_in import StandIn

pytestmark = [pytest.mark.system, needs_browser]


def test_a_browser_that_died_is_started_anew(playwright: Playwright, serve: Serve) -> None:
    live_browser = LiveBrowser(playwright)
    watched, url = Watched(live_browser), serve(StandIn()).urls.viewer
    died = watched(url).context.browser
    assert died is live_browser()
    with suppress(Error):
        died.new_browser_cdp_session().send("Browser.crash")
    with pytest.raises(Error):
        watched.close()
    assert live_browser() is not died
    watched(url)
    watched.close()
    live_browser().close()
