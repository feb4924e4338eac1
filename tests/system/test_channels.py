"""Slow channels of a daemon: shown, recorded, and a trip by one that is too hot or broken.

A driver that hangs, or that takes the process along, costs its channel and nothing else.
"""

import os
import signal

import numpy as np
import pytest

from motord.client import ClientError
from tests.support.channel_package import install
from tests.support.patience import until
from tests.system.daemons import daemon, resets, wait_for, write_sim

pytestmark = [pytest.mark.system, pytest.mark.slow]

CHANNELS = """
[[channels]]
name = "winding_C"
unit = "degC"
rate_Hz = 5.0
warn_below = 10.0
source = {driver = "simulated"}

[[channels]]
name = "probe_C"
unit = "degC"
rate_Hz = 10.0
timeout_s = 8.0
valid_min = -40.0
warn_above = 100.0
trip_above = 130.0
valid_max = 300.0
source = {driver = "scripted", settings = {script = "probe"}}

[[channels]]
name = "other"
unit = ""
rate_Hz = 10.0
timeout_s = 2.0
source = {driver = "scripted", settings = {script = "other"}}
"""


@pytest.fixture(scope="module")
def running(folder):
    for name in ("probe", "other"):
        script(folder, name, "40.5")
    path = write_sim(folder)
    path.write_text(f"{path.read_text()}{CHANNELS}")
    with pytest.MonkeyPatch.context() as patch:
        install(folder, patch)
        with daemon(folder, path) as program:
            yield program


def script(folder, name, text):
    """Let a scripted channel say this."""
    part = folder / f"{name}.part"
    part.write_text(text)
    part.rename(folder / name)


def shown(client, name):
    return {channel.name: channel for channel in client.state().channels}[name]


def test_a_channel_that_is_too_hot_or_broken_trips_and_one_that_hangs_costs_itself(
    folder, running, client
):
    state = wait_for(client, lambda s: {c.status for c in s.channels} == {"ok"}, "all channels")
    assert [c.name for c in state.channels] == ["winding_C", "probe_C", "other"]
    winding, probe, _ = state.channels
    assert 24.9 < winding.value < 40.0
    assert probe.value == 40.5
    with client.lease("anna") as lease:
        until(lambda: resets(client, lease), "no cause of a trip to be left")
        lease.set(enable=True, torque_Nm=1.0, speed_Hz=2.0)
        script(folder, "other", "hang")
        until(lambda: shown(client, "other").status == "broken", "one that hangs")
        assert client.state().state == "ENABLED"
        script(folder, "probe", "101")
        until(lambda: shown(client, "probe_C").status == "warn", "a warning")
        script(folder, "probe", "150")
        until(lambda: client.state().state == "TRIPPED", "the trip")
        state = client.state()
        assert state.first_trip == "CHANNEL"
        value = state.trip.values["channel probe_C, degC"]
        assert (value.value, value.limit) == (150.0, 130.0)
        assert not state.tick.torque_set_Nm
        with pytest.raises(ClientError, match="probe_C: 150 degC, limit 130 degC"):
            lease.reset()
        script(folder, "probe", "41")
        until(lambda: shown(client, "probe_C").status == "ok", "a cooler one")
        lease.reset()
        lease.set(enable=True, torque_Nm=1.0, speed_Hz=2.0)

        before = client.state().processes["channels"].pid
        os.kill(before, signal.SIGKILL)
        until(lambda: shown(client, "other").value == 40.5, "the next process")
        process = client.state().processes["channels"]
        assert process.pid != before
        assert process.restarts == 1

        script(folder, "probe", "nan")
        until(lambda: client.state().state == "TRIPPED", "the trip by a broken sensor")
        assert client.state().first_trip == "CHANNEL"
        assert shown(client, "probe_C").value is None
        script(folder, "probe", "die")  # with the process, again and again
        until(lambda: client.state().processes["channels"].restarts > 2, "restarts")
        assert client.state().fault == ""
    said = [event.message for event in client.events() if event.kind == "channel"]
    assert any(one.startswith("other is broken, was ok: no reading for") for one in said)

    assert running.end() == 0
    runs = running.runs()
    assert {name: one.unit for name, one in runs[0].channels().items()} == {
        "winding_C": "degC", "probe_C": "degC", "other": "",
    }  # fmt: skip
    times_ns, values = runs[0].channel("probe_C")
    assert (np.diff(times_ns) > 0).all()
    assert {40.5, 101.0, 150.0} <= set(values)
    ticks = runs[0].ticks(["t_ns"])["t_ns"]
    assert ticks[0] - 1e9 < times_ns[0]
    assert times_ns[-1] < ticks[-1] + 1e9
