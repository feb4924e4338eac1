"""Slow channels in `motord status`, `watch` and `check`, as text."""

from types import SimpleNamespace

import pytest

from motord.api.published_message import ChannelView
from motord.cli.bench import wording
from motord.cli.bench.status import table
from motord.cli.bench.watch import panels
from motord.cli.check import probe_devices
from motord.config import ChannelConfig, load
from motord.hal.channel_source import RawSample
from tests.support.channel_package import install
from tests.unit.cli.watch.samples import state

LIMITS = {"warn_below": 0.0, "warn_above": 100.0, "trip_above": 130.0}


def view(value: float | None, status: str, error: str = "", **about: object) -> ChannelView:
    made = {"name": "winding_C", "unit": "degC", "value": value, "status": status, "age_s": 0.24}
    return ChannelView.model_validate({**made, "error": error, **LIMITS, **about})


TEXTS = [
    (view(21.5, "ok"), "21.5 degC, ok, 0.2 s old"),
    (view(101.25, "warn"), "101.25 degC, warn, 0.2 s old: limit 100"),
    (view(-1.0, "warn"), "-1 degC, warn, 0.2 s old: limit 0"),
    (view(131.0, "trip"), "131 degC, trip, 0.2 s old: limit 130"),
    (view(None, "broken", "the probe is off"), "no value, broken, 0.2 s old: the probe is off"),
    (view(None, "broken", "nothing yet", age_s=None), "no value, broken: nothing yet"),
    (view(3.0, "frozen", unit=""), "3, frozen, 0.2 s old"),
]


@pytest.mark.parametrize(("channel", "text"), TEXTS)
def test_a_channel_in_words(channel, text):
    assert wording.channel(channel) == text


def test_status_and_watch_have_a_line_for_channels():
    shown = state().model_copy(update={"channels": [view(21.5, "ok"), view(150.0, "trip")]})
    rows = table(shown)
    cells = [list(column.cells) for column in rows.columns]
    assert ("winding_C", TEXTS[0][1]) in zip(*cells, strict=True)
    [line] = panels.channels(shown, 200)
    first, second = line.plain.removeprefix("channels").strip().split("; ")
    assert first == f"winding_C {wording.channel(shown.channels[1])}"
    assert second == "winding_C 21.5 degC"
    assert len(panels.channels(shown, 40)) == 2
    assert panels.channels(state(), 80) == []
    many = shown.model_copy(update={"channels": [view(1.0, "ok")] * 64})
    assert len(panels.channels(many, 40)) == panels.CHANNEL_ROWS


@pytest.mark.parametrize(
    ("said", "ok", "message"),
    [
        ("21.5", True, "scripted: 21.5 degC, ok"),
        ("140", True, "scripted: 140 degC, trip"),
        ("nan", False, "its reading is not a number"),
        ("fault", False, "the probe is off"),
        ("raise", False, "error in its driver: ZeroDivisionError: a mistake"),
        ("nothing", False, "nothing came within timeout_s = 0.2"),
    ],
)
def test_check_says_what_each_channel_reads(said, ok, message, tmp_path, monkeypatch):
    install(tmp_path, monkeypatch)
    script = tmp_path / "script"
    script.write_text(said)
    found = checked(channel({"script": str(script)}), tmp_path, monkeypatch)
    assert found["ok"] is ok
    assert found["message"].startswith(message)


def test_check_names_a_driver_that_cannot_be_closed(tmp_path, monkeypatch):
    source = SimpleNamespace(
        open=lambda: None, read=lambda: RawSample(21.5, 0), close=lambda: 1 / 0
    )
    scripted = channel({})
    monkeypatch.setattr("motord.hal.channels.registry.make_lines", lambda _: [[(scripted, source)]])
    found = checked(scripted, tmp_path, monkeypatch)
    assert not found["ok"]
    assert found["message"].startswith("error in its driver: ZeroDivisionError")


def channel(settings):
    source = {"driver": "scripted", "settings": settings}
    about = {"name": "probe_C", "unit": "degC", "rate_Hz": 20.0, "timeout_s": 0.2}
    return ChannelConfig.model_validate({**about, "trip_above": 130.0, "source": source})


def checked(channel, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    findings = probe_devices(load().model_copy(update={"channels": (channel,)}))
    return next(one for one in findings if one["what"] == "channel probe_C")
