"""config/foxglove/motord.json: every path is one of the recording's, every panel has its place."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from motord.recording import topics
from motord.schema import TICK, TRUTH

LAYOUT = json.loads((Path(__file__).parents[3] / "config" / "foxglove" / "motord.json").read_text())
FIELDS = {
    topics.TICKS.name: {field.name for field in TICK.fields},
    topics.TRUTHS.name: {field.name for field in TRUTH.fields},
}


def panels(node: Any) -> Iterator[str]:
    """Yield the panels of a layout: a name, or two parts beside or above each other."""
    if isinstance(node, str):
        yield node
        return
    assert set(node) == {"direction", "first", "second", "splitPercentage"}
    assert node["direction"] in ("row", "column")
    assert 0 < node["splitPercentage"] < 100
    yield from panels(node["first"])
    yield from panels(node["second"])


def test_every_panel_is_shown_once() -> None:
    shown = list(panels(LAYOUT["layout"]))
    assert sorted(shown) == sorted(LAYOUT["configById"])
    assert all(re.fullmatch(r"(Plot|StateTransitions|RawMessages)!\w+", name) for name in shown)


PATHS = [
    (name, path) for name, panel in LAYOUT["configById"].items() for path in panel.get("paths", ())
]


@pytest.mark.parametrize(("name", "path"), PATHS, ids=lambda x: x if isinstance(x, str) else "")
def test_every_path_is_a_field_of_a_recording(name: str, path: dict[str, Any]) -> None:
    topic, field = path["value"].split(".")
    assert field in FIELDS[topic], name
    assert path["timestampMethod"] in ("receiveTime", "headerStamp")
    assert path["enabled"] is True


def test_what_an_operator_looks_for_is_there() -> None:
    shown = {path["value"].removeprefix("/tick.") for _, path in PATHS}
    assert {"torque_Nm", "i_a_A", "i_b_A", "i_c_A", "speed_rad_s", "state", "u_bus_V"} <= shown


def test_raw_messages_are_of_topics_that_there_are() -> None:
    known = {topic.name for topic in topics.ALL}
    raw = [panel for name, panel in LAYOUT["configById"].items() if name.startswith("RawMessages")]
    assert raw
    assert all(panel["topicPath"] in known for panel in raw)
