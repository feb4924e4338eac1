"""Make the screenshots of the page for README and docs: `make pictures`.

The page is the real one, in Chromium, with the page's server; the bench behind it is the stand-in
of tests/browser, so that all of it is to be seen within seconds.
"""

import io
import sys
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from tests.browser.chromium import (  # noqa: E402
    PHONE,
    chromium,
    open_page,
    set_by_hand,
    start_plan,
    take_command,
)  # fmt: skip
from tests.browser.stand_in import Server, StandIn  # noqa: E402

IMAGES = ROOT / "docs" / "images"
COLOURS = 255
POINTS_TAKEN = 20


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
    return taken


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else IMAGES)
