"""What `motord set` says at the end, where all is not as it was set."""

from types import SimpleNamespace

import pytest

from motord.api.messages import RecordingView
from motord.cli.bench import operate, wording
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
