"""What `motord set` answers: where the bench is going, then where it came to."""

import time
from typing import TYPE_CHECKING

import typer

from motord.cli.bench.status import sensor_text
from motord.cli.bench.wording import number, recording

if TYPE_CHECKING:
    from motord.api.messages import BenchState
    from motord.api.replies import SetpointReply
    from motord.client import Client

LATE_S = 1.0
"""So much longer than expected the ramp is waited for."""
LOOK_S = 0.5


def set_text(answer: "SetpointReply") -> str:
    """Return what was set, and when it will be reached."""
    s = answer.setpoint
    speed = "not held" if s.speed_Hz is None else f"{s.speed_Hz:g} Hz"
    when = f", reached in {answer.reached_in_s:.1f} s" if answer.reached_in_s else ""
    return (
        f"set: torque {s.torque_target_Nm:g} Nm{when}; speed {speed}, brake {s.brake:.3g}, "
        f"drive {s.drive_Hz:g} Hz, compensation {s.compensate}"
    )


def show_reached(client: "Client", answer: "SetpointReply", for_s: float | None) -> None:
    """Wait until the torque is the one that was set, and print what the bench measures then.

    Not for longer than `for_s`.
    """
    target_Nm = answer.setpoint.torque_target_Nm
    if not answer.reached_in_s:
        return
    wait_s = answer.reached_in_s + LATE_S
    end_s = time.monotonic() + (wait_s if for_s is None else min(wait_s, for_s))
    state = None
    with client.subscribe_state() as states:
        while time.monotonic() < end_s:
            state = states.get(LOOK_S) or state
            if state is not None and (_is_there(state, target_Nm) or state.state != "ENABLED"):
                break
    if state is not None and state.tick is not None:
        typer.echo(_reached(state, target_Nm))


def _is_there(state: "BenchState", target_Nm: float) -> bool:
    return (
        state.tick is not None
        and state.setpoint.torque_target_Nm == target_Nm == state.setpoint.torque_Nm
        and abs((state.tick.torque_set_Nm or 0.0) - target_Nm) < 1e-6
    )


def _reached(state: "BenchState", target_Nm: float) -> str:
    assert state.tick is not None
    when = "reached" if _is_there(state, target_Nm) else f"now, {state.state}"
    held_Hz, record = state.setpoint.speed_Hz, state.recording
    aim = f" of {held_Hz:g} Hz" if held_Hz is not None else ""
    unrecorded = not record.recording and (record.error or record.obstacle)
    return (
        f"{when}: torque {number(state.tick.torque_set_Nm)} Nm commanded, {sensor_text(state)}; "
        f"speed {number(state.tick.speed_Hz)} Hz{aim}"
        + (f"; {recording(state)}" if unrecorded else "")
    )
