"""config/foxglove/motord.json: every panel has its place, every path is served and recorded."""

import base64
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from motord.foxglove.server import FoxgloveServer
from motord.recording import topics
from tests.support.foxglove_client import Viewer, field_names

LAYOUT = json.loads((Path(__file__).parents[3] / "config" / "foxglove" / "motord.json").read_text())
PANELS = LAYOUT["configById"]
LIVE_ONLY = {"/tick_extremes", "/bench"}
"""A recording has every tick, so it needs no extremes, and says in `/event` what a trip was."""


def shown(node: Any) -> Iterator[str]:
    """Yield the panels of a layout: a name, or two parts next to or above each other."""
    if isinstance(node, str):
        yield node
        for tab in PANELS.get(node, {}).get("tabs", ()):
            yield from shown(tab["layout"])
        return
    assert set(node) == {"direction", "first", "second", "splitPercentage"}
    assert node["direction"] in ("row", "column")
    assert 0 < node["splitPercentage"] < 100
    yield from shown(node["first"])
    yield from shown(node["second"])


def paths() -> Iterator[tuple[str, str]]:
    """Yield the name of a panel and a path of it, for all."""
    for name, panel in PANELS.items():
        for path in panel.get("paths", ()):
            assert path["timestampMethod"] in ("receiveTime", "headerStamp")
            assert path["enabled"] is True
            yield name, path["value"]
        if "xAxisPath" in panel:
            yield name, panel["xAxisPath"]["value"]
        for key in ("path", "topicPath", "topicToRender"):
            if key in panel:
                yield name, panel[key]


PATHS = list(paths())


@pytest.fixture(scope="module")
def served() -> Iterator[dict[str, set[str]]]:
    """The fields of each topic that a viewer is offered."""
    server = FoxgloveServer("layout", 0)
    with Viewer(server.url) as viewer:
        viewer.receive_until(lambda: "/mesh" in viewer.channels, "the topics")
        yield {name: field_names(channel) for name, channel in viewer.channels.items()}
    server.stop()


def recorded() -> dict[str, set[str]]:
    """The fields of each topic of a recording; of documents without schema, none are known."""
    found = {}
    for topic in topics.ALL:
        text = topic.schema.data
        protobuf = topic.schema.encoding == "protobuf"
        channel = {
            "encoding": topic.channel.message_encoding,
            "schemaName": topic.schema.name,
            "schema": base64.b64encode(text) if protobuf else text.decode(),
        }
        found[topic.name] = field_names(channel)
    return found


def test_every_panel_is_shown_once() -> None:
    names = list(shown(LAYOUT["layout"]))
    assert sorted(names) == sorted(PANELS)
    kinds = "Plot|StateTransitions|RawMessages|RosOut|Indicator|Parameters|Tab"
    assert all(re.fullmatch(rf"({kinds})!\w+", name) for name in names)


@pytest.mark.parametrize(("name", "path"), PATHS)
def test_every_path_is_served(name: str, path: str, served: dict[str, set[str]]) -> None:
    topic, _, field = path.partition(".")
    assert topic in served, name
    assert not field or field in served[topic], name


@pytest.mark.parametrize(("name", "path"), PATHS)
def test_every_path_is_recorded(name: str, path: str) -> None:
    topic, _, field = path.partition(".")
    found = recorded()
    assert topic in found.keys() | LIVE_ONLY, name
    assert not field or topic in LIVE_ONLY or field in found[topic], name


def test_the_log_panel_gets_messages_that_it_knows() -> None:
    assert PANELS["RosOut!log"]["topicToRender"] == topics.EVENTS.name
    assert topics.EVENTS.schema.name == "foxglove.Log"


def test_the_indicator_knows_every_state(served: dict[str, set[str]]) -> None:
    rules = {rule["rawValue"] for rule in PANELS["Indicator!state"]["rules"]}
    assert rules == {"OFF", "READY", "ENABLED", "TRIPPED"}


def test_what_an_operator_looks_for_is_there() -> None:
    values = {path.removeprefix("/tick.") for _, path in PATHS}
    wanted = {"torque_Nm", "i_a_A", "i_b_A", "i_c_A", "speed_rad_s", "angle_rad", "u_bus_V"}
    assert wanted | {"/state.state", "/state.first_trip", "/event"} <= values
