"""Notes in a recording, on the page of whatever is made of it."""

from pathlib import Path

from motord.experiments.operator_notes import SHOWN_MAX, add_operator_notes
from motord.experiments.subject import Recordings
from motord.recording.writer import RunWriter
from motord.report.html import Page
from tests.unit.recording.runs import METADATA, PERIOD_NS, START_NS, point_of, tick_block

POINT = point_of(tick_block(61)[20:]) | {"index": 3, "torque_Nm": 2.0, "speed_Hz": 0.7}


def page_of(path: Path, notes: str, texts: dict[int, str]) -> str:
    """Return the page of a recording with a note at each of these ticks."""
    with RunWriter(path, {**METADATA, "notes": notes}) as writer:
        writer.ticks(tick_block(100))
        writer.operating_point(POINT["t_end_ns"], POINT)
        for tick, text in texts.items():
            t_ns = START_NS + tick * PERIOD_NS
            writer.event(t_ns, "note", text, {"by": "anna@bench"})
            writer.event(t_ns, "request", "enable, from anna@bench")
    page = Page("A page")
    add_operator_notes(page, Recordings.open([path]))
    return page.html()


def test_notes_are_listed_in_order_with_time_and_operating_point(tmp_path: Path) -> None:
    html = page_of(
        tmp_path / "a.mcap", "new bearing, 3 +- 1", {70: "3 +- 1 over", 40: "it <b>squeals</b>"}
    )
    assert "<p>new bearing, 3 +- 1</p>" in html
    assert "<td>2023-11-14 22:13:20.0</td><td>a.mcap</td><td>3: 2 Nm, 0.7 Hz</td>" in html
    assert "<td>it &lt;b&gt;squeals&lt;/b&gt;</td><td>anna@bench</td>" in html
    assert "<td>a.mcap</td><td></td><td>3 +- 1 over</td>" in html
    assert html.index("squeals") < html.index("over</td>")
    assert "enable" not in html


def test_a_recording_without_notes_has_no_section(tmp_path: Path) -> None:
    assert page_of(tmp_path / "a.mcap", "", {}) == Page("A page").html()


def test_of_very_many_the_first_are_shown(tmp_path: Path) -> None:
    texts = {tick: f"note {tick}." for tick in range(SHOWN_MAX + 5)}
    html = page_of(tmp_path / "a.mcap", "", texts)
    assert f"note {SHOWN_MAX - 1}." in html
    assert f"note {SHOWN_MAX}." not in html
    assert "5 more are among the recordings" in html
