"""What `motord set` says at the end, where all is not as it was set."""

from contextlib import nullcontext
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

from motord.api.messages import RecordingView
from motord.cli.bench import operate, wording
from motord.cli.bench.watch import command
from motord.client import ClientError
from tests.support.played_benches import state_of


@pytest.mark.parametrize(
    ("recording", "said"),
    [
        (RecordingView(recording=True, path="run.mcap.part"), ""),
        (RecordingView(recording=False, path=""), ""),
        (RecordingView(recording=True, path="a.mcap", error="silent"), "; a.mcap: silent"),
        (RecordingView(recording=False, path="", error="no space"), "; not recording: no space"),
        (RecordingView(recording=False, path="", obstacle="full"), "; not recording: full"),
    ],
)
def test_a_bench_that_should_be_recorded_and_is_not_is_said(monkeypatch, recording, said):
    monkeypatch.setattr(operate, "sensor_text", lambda _state: "1 Nm measured")
    tick = SimpleNamespace(torque_set_Nm=1.0, speed_Hz=0.25)
    state = state_of("a", recording=recording).model_copy(update={"tick": tick})
    text = operate._reached(state, 0.0)
    assert text == f"now, OFF: torque 1 Nm commanded, 1 Nm measured; speed 0.25 Hz{said}"


@pytest.mark.parametrize(
    ("value", "said"),
    [(-1.5e-7, "0"), (0.0, "0"), (1e-6, "1e-06"), (-0.25, "-0.25"), (float("nan"), "nan")],
)
def test_a_rotor_at_rest_has_no_speed_of_rounding(value: float, said: str) -> None:
    assert wording.number(value) == said


def coming(states):
    """Return a client whose subscription to states brings these, None for a wait in vain."""
    subscription = SimpleNamespace(get=lambda timeout_s: states.pop(0))
    return SimpleNamespace(bench="a", subscribe_state=lambda: nullcontext(subscription))


def test_a_command_that_was_stopped_while_it_waited_says_what_was_reached(monkeypatch, capsys):
    """As by Ctrl-Z: its clock has gone on, and the states that came meanwhile are still there."""
    clock_s = count(0, 60)
    monkeypatch.setattr(operate, "time", SimpleNamespace(monotonic=lambda: next(clock_s)))
    monkeypatch.setattr(operate, "sensor_text", lambda _state: "1 Nm measured")
    later, there = (state_of("a", state="ENABLED", t_ns=t_ns) for t_ns in (0, 900_000_000))
    for state, torque_Nm in ((later, 0.5), (there, 1.0)):
        state.__dict__["tick"] = SimpleNamespace(torque_set_Nm=torque_Nm, speed_Hz=0.25)
        state.__dict__["setpoint"] = SimpleNamespace(torque_Nm=1.0, target_Nm=1.0, speed_Hz=None)
    answer = SimpleNamespace(setpoint=there.setpoint, reached_in_s=0.1)
    operate.show_reached(coming([later, None, there]), answer, None)
    assert capsys.readouterr().out.startswith("reached: torque 1 Nm commanded, ")


def test_a_torque_that_is_not_reached_is_not_waited_for(monkeypatch, capsys):
    monkeypatch.setattr(operate, "sensor_text", lambda _state: "1 Nm measured")
    states = [state_of("a", state="ENABLED", t_ns=n * 10**9) for n in range(9)]
    for state in states:
        state.__dict__["tick"] = SimpleNamespace(torque_set_Nm=0.5, speed_Hz=0.25)
    answer = SimpleNamespace(setpoint=SimpleNamespace(target_Nm=1.0), reached_in_s=2.5)
    operate.show_reached(coming(states), answer, None)
    assert len(states) == 9 - 1 - 4  # the first, and those of LATE_S longer than expected
    assert capsys.readouterr().out.startswith("now, ENABLED: torque 0.5 Nm commanded")
    operate.show_reached(coming([None] * 7), answer, None)
    assert capsys.readouterr().out == ""


def test_a_watch_that_was_stopped_itself_takes_no_bench_for_silent():
    shown = []
    command._each_state(coming([None, state_of("a")]), 0.0, shown.append)
    assert len(shown) == 1
    with pytest.raises(ClientError, match="silent"):
        command._each_state(coming([None, None]), 0.0, shown.append)


@pytest.mark.parametrize(
    ("target_Nm", "ticks_Nm", "there"),
    [(4999.3, float(np.float32(4999.3)), True), (1e-6, 5e-7, False), (0.0, 0.0, True)],
)
def test_reached_is_the_torque_of_a_tick_in_single_precision(target_Nm, ticks_Nm, there):
    state = state_of("a", state="ENABLED")
    state.__dict__["tick"] = SimpleNamespace(torque_set_Nm=ticks_Nm)
    state.__dict__["setpoint"] = SimpleNamespace(torque_Nm=target_Nm, target_Nm=target_Nm)
    assert operate._is_there(state, target_Nm) is there
