"""Make the screenshots of the page for README and docs: `make pictures`.

The page is the real one, in Chromium, with the page's server; the bench behind it is the stand-in
of tests/browser, so that all of it is to be seen within seconds.
"""

import asyncio
import io
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import Browser

from motord.api.messages import BenchState, LeaseView
from motord.api.plan_messages import PlanView
from motord.api.queue_messages import QueueView
from motord.client.roster import BenchEntry
from motord.dashboard.app import application
from motord.dashboard.overview.bench_list import BenchList
from motord.dashboard.overview.overview_pages import OverviewPages, command_for
from motord.dashboard.tokens import Tokens
from motord.security.roles import Role

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from tests.browser import documents  # noqa: E402
from tests.browser.chromium import (  # noqa: E402
    PHONE,
    chromium,
    open_page,
    set_by_hand,
    shows,
    start_plan,
    take_command,
)  # fmt: skip
from tests.browser.stand_in import AppServer, Server, StandIn  # noqa: E402

IMAGES = ROOT / "docs" / "images"
COLOURS = 255
POINTS_TAKEN = 20
SMALL = {"width": 1100, "height": 590}


def save(png: bytes, name: str, folder: Path) -> None:
    """Write a picture with as many colours as it needs."""
    image = Image.open(io.BytesIO(png)).convert("RGB")
    fewer = image.quantize(COLOURS, dither=Image.Dither.NONE)
    fewer.save(folder / f"dashboard-{name}.png", optimize=True)


def main(folder: Path) -> None:
    """Write the pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, png in pictures().items():
        save(png, name, folder)


def picture_of_all(browser: Browser, stand_in: StandIn) -> bytes:
    """Take the picture of all benches: one with a plan, one tripped, one silent, one that goes."""
    lease = LeaseView(holder=None, remaining_s=0.0, duration_s=2.0)
    state = BenchState.model_validate(documents.state(stand_in, 1.0, 0.0))
    state = state.model_copy(update={"lease": lease})
    off: dict[str, Any] = {
        "state": "OFF",
        "trips": [],
        "first_trip": "",
        "trip": None,
        "plan": None,
        "queue": None,
    }
    plan = {"plan": "calibrate", "state": "running", "serial": "AX-0117", "points": 30}
    now = {"points_done": 12, "fraction": 0.4, "eta_s": 640.0}
    running: dict[str, Any] = {
        **off,
        "state": "ENABLED",
        "plan": PlanView.model_validate({**plan, **now}),
    }
    running["queue"] = QueueView(state="running", length=3, eta_s=4000.0)
    tripped: dict[str, Any] = {"queue": None}
    rigs = [
        BenchEntry(f"rig-{n}", state.model_copy(update=changes), age_s, True, 1, "", endpoint)
        for n, (changes, age_s, endpoint) in enumerate(
            (
                (running, 0.04, "tcp/127.0.0.1:7447"), (tripped, 0.06, "tcp/127.0.0.1:7449"),
                (off, 42.0, "tls/bench.lab:7448"), (off, 0.05, "tls/bench.lab:7448"),
            ), start=1,
        )
    ]  # fmt: skip
    tokens, link = Tokens(Role.VIEWER), ListedBenches(rigs)
    pages = OverviewPages(BenchList(command_for(None)), list)
    with AppServer(application(pages, tokens, link, "benches.html"), tokens) as server:
        page = open_page(browser, server.urls.viewer, SMALL, color_scheme="light")
        page.locator(".bench").nth(3).wait_for()
        rigs.pop()
        shows(page, "#benches", "vanished at")
        return page.screenshot()


class ListedBenches:
    """Benches as a list says."""

    def __init__(self, entries: list[BenchEntry]) -> None:
        self._entries = entries

    def start(self, take: Callable[[list[BenchEntry]], None]) -> None:
        """Give them to `take`, again and again."""
        self._take = take

    async def keep(self, connected: object) -> None:
        """Never return."""
        while True:
            self._take(list(self._entries))
            await asyncio.sleep(0.2)


def fill_queue(stand_in: StandIn) -> None:
    """Give the stand-in a queue of three plans, of which the first runs for a second time."""
    cool = [{"channel": "winding_C", "below": 40.0, "limit_s": 3600.0}]
    stand_in.queue.add(
        [
            {"name": "calibrate", "settings": {"torques_Nm": [2.0, 4.0]}, "serial": "AX-0117",
             "on_failure": "retry", "retries": 2},
            {"name": "verify", "serial": "AX-0117", "wait": cool, "on_failure": "skip"},
            {"name": "cogging", "wait": [{"until": "06:00"}], "notes": "bearing is warm"},
        ]
    )  # fmt: skip
    stand_in.queue.start("")
    stand_in.queue.end("failed", "the speed was still 3.1 % off after 30 s")
    stand_in.queue.start("")


def pictures() -> dict[str, bytes]:
    """Operate the stand-in, and take pictures on the way."""
    taken: dict[str, bytes] = {}
    stand_in = StandIn()
    with Server(stand_in) as server, chromium() as browser:
        page = open_page(browser, server.urls.operator, color_scheme="light")
        take_command(page)
        set_by_hand(page, 3.0, 0.7)
        page.wait_for_timeout(14_000)
        stand_in.do(lambda: stand_in.event("note", "bearing is warm now", by="anna"))
        page.wait_for_timeout(2_500)
        page.evaluate("document.activeElement.blur()")
        taken["light"] = page.screenshot()
        page.emulate_media(color_scheme="dark")
        page.wait_for_timeout(300)
        taken["dark"] = page.screenshot()
        phone = open_page(browser, server.urls.viewer, PHONE, device_scale_factor=2)
        phone.wait_for_timeout(1_500)
        taken["phone"] = phone.screenshot()
        stand_in.points_max = POINTS_TAKEN
        start_plan(page)
        page.click("#tab-health")
        taken_cell = page.locator("#mesh td.done").nth(POINTS_TAKEN - 1)
        taken_cell.wait_for()
        taken["sweep"] = page.screenshot()
        stand_in.do(stand_in.trip_over_current)
        page.emulate_media(color_scheme="light")
        page.wait_for_timeout(1_500)
        taken["trip"] = page.screenshot()
        stand_in.do(lambda: fill_queue(stand_in))
        shows(page, "#queue-items", "1 attempt")
        taken["queue"] = page.locator("#queue").screenshot()
        taken["all"] = picture_of_all(browser, stand_in)
    return taken


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else IMAGES)
