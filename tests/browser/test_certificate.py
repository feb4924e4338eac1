"""The certificate in Chromium: one page of A4, nothing from elsewhere."""

import re
from datetime import UTC, datetime

import pytest

from motord.verdict.certificate import Certificate
from motord.verdict.decision import MotorVerdict
from motord.verdict.motor_type import FigureLimit, MotorType
from motord.verdict.recordings import UsedRecording
from tests.unit.verdict.made_up import decided

NAME = "back-emf back_emf_V_s_per_rad, order"


def certificate(figures: int) -> Certificate:
    limit = FigureLimit(analysis="calibrate", figure="alpha", low=0.9, high=1.1)
    bounds = ({"low": 0.9, "high": 1.1}, {"high": 1.1}, {"low": 0.9})
    verdicts = [
        decided(
            0.85 + 0.01 * n,
            u=0.01,
            name=f"{NAME} {n} (V s/rad)",
            **bounds[n % 3],
        )
        for n in range(figures)
    ]
    recording = UsedRecording(
        f"runs/series-20250101T120000000Z-inertia-acceleration-{0:03d}.mcap", "a5" * 32,
        "inertia-acceleration", "2025-01-01T12:00:00.000Z", "",
    )  # fmt: skip
    return Certificate(
        MotorType(motor="axial-flux 48/16", limit=(limit,)), "types/pump.toml", "5a" * 32,
        "A/7 " + "x" * 40, "anna@bench", datetime(2025, 1, 1, tzinfo=UTC), "1.2.3.dev4+gabcdef",
        MotorVerdict(tuple(verdicts)), (recording,) * 4,
        (("calibrate", "warning", "few-points"),) * 3,
    )  # fmt: skip


@pytest.mark.parametrize(("figures", "pages"), [(30, 1), (120, 3)])
def test_it_prints_on_one_page_with_thirty_figures(browser, tmp_path, figures, pages):
    path = tmp_path / "c.html"
    certificate(figures).page().write(path)
    page = browser.new_page()
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto(path.as_uri())
    printed = page.pdf(prefer_css_page_size=True)
    page.close()
    assert len(re.findall(rb"/Type\s*/Page[^s]", printed)) == pages
    assert b"/MediaBox [0 0 594" in printed or b"/MediaBox [0 0 595" in printed
    assert requests == [path.as_uri()]
