"""`motord enable|disable|stop|reset|set|note`: manual operation of a bench."""

import time
from contextlib import suppress
from math import isclose
from operator import attrgetter, methodcaller
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from motord.cli.bench.lease_session import announce, command, hold, in_command
from motord.cli.bench.status import sensor_text
from motord.cli.bench.wording import number, recording
from motord.cli.common_options import AsJson
from motord.cli.connection_options import DEFAULT, Connection, Force, print_answer
from motord.cli.console import print_line

if TYPE_CHECKING:
    from motord.api.messages import BenchState
    from motord.api.replies import SetpointReply
    from motord.client import Client


ForS = Annotated[
    float | None,
    typer.Option("--for-s", min=0, metavar="S", help="Stay in command this long only."),
]

CompensateOption = Literal["off", "on", "calibration", "currents", "cogging"]
"""`motord.sequencing.settings.Compensation`, without loading it."""

LATE_S = 1.0
"""So much longer than expected the ramp is waited for."""

LOOK_S = 0.5

SINGLE = 2.0**-22
"""Part of itself by which a torque in single precision, as ticks have it, may be off."""


def enable(
    connection: Connection = DEFAULT,
    for_s: ForS = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Enable at zero torque, and stay in command.

    While it runs, `motord set` in another terminal sets torque and speed. When it ends, the bench
    ramps down and is disabled.
    """
    with connection.connect() as client, in_command(client, force=force) as session:
        answer = session.commander.enable()
        print_answer(answer.content(), answer.state, as_json)
        if session.lease is not None:
            if not as_json:
                announce(answer.state, for_s)
            hold(client, session.lease, answer, for_s)


def disable(
    connection: Connection = DEFAULT, force: Force = False, as_json: AsJson = False
) -> None:
    """Ramp the torque to zero, then disable; ends a plan."""
    ask, text = methodcaller("disable"), attrgetter("state")
    command(ask, connection, text, force=force, as_json=as_json)


def stop(connection: Connection = DEFAULT, as_json: AsJson = False) -> None:
    """Zero current now and OFF, whoever is in command."""
    with connection.connect() as client:
        answer = client.stop()
        print_answer(answer.content(), answer.state, as_json)


def reset(connection: Connection = DEFAULT, force: Force = False, as_json: AsJson = False) -> None:
    """Leave a trip whose cause is gone; start the loop anew if it has ended or hangs."""
    ask, text = methodcaller("reset"), attrgetter("state")
    command(ask, connection, text, force=force, as_json=as_json)


def note(
    text: Annotated[list[str], typer.Argument(metavar="TEXT", help="What is to be remembered.")],
    connection: Connection = DEFAULT,
    as_json: AsJson = False,
) -> None:
    """Put a remark with its time into events and recording; needs no lease."""
    with connection.connect() as client:
        answer = client.note(" ".join(text))
    where = answer.recording or "the events alone: nothing is being recorded"
    print_answer(answer.content(), f"noted in {where}", as_json)


def set_(
    torque_Nm: Annotated[
        float | None, typer.Option("--torque-Nm", metavar="T", help="Torque set-point.")
    ] = None,
    speed_Hz: Annotated[
        float | None,
        typer.Option("--speed-Hz", metavar="F", help="Turns per second, held by the brake."),
    ] = None,
    brake: Annotated[
        float | None, typer.Option(min=0, max=1, metavar="E", help="Brake excitation itself.")
    ] = None,
    drive_Hz: Annotated[
        float | None, typer.Option("--drive-Hz", metavar="F", help="Speed of the external drive.")
    ] = None,
    compensate: Annotated[
        CompensateOption | None, typer.Option(help="What of the calibration is applied.")
    ] = None,
    enable_first: Annotated[bool, typer.Option("--enable", help="Enable first.")] = False,
    connection: Connection = DEFAULT,
    for_s: ForS = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Set torque, speed, brake or drive; what is left out stays as it is.

    All of it is checked before any of it is done, and before the bench is enabled. It lasts as long
    as somebody is in command: if another command of yours is (`motord enable`), this one ends once
    the torque is reached, else it stays in command itself until Ctrl-C. Then torque ramps down, the
    bench is disabled, the brake opens and the drive stops.
    """
    given: dict[str, Any] = {
        "torque_Nm": torque_Nm,
        "speed_Hz": speed_Hz,
        "brake": brake,
        "drive_Hz": drive_Hz,
        "compensate": compensate,
    }
    asked = {key for key, value in given.items() if value is not None}
    if not asked:
        raise typer.BadParameter("nothing to set: give at least one of the options above")
    with connection.connect() as client, in_command(client, force=force) as session:
        answer = session.commander.set(**given, enable=enable_first)
        print_answer(answer.content(), set_text(answer), as_json)
        begun_s = time.monotonic()
        lease = None if asked == {"compensate"} else session.lease
        with suppress(KeyboardInterrupt):
            if not as_json:
                if lease is not None:
                    announce(answer.state, for_s)
                show_reached(client, answer, for_s)
            if lease is not None:
                left_s = None if for_s is None else for_s - (time.monotonic() - begun_s)
                hold(client, lease, answer, left_s)


def set_text(answer: "SetpointReply") -> str:
    """Return what was set, and when it will be reached."""
    s = answer.setpoint
    speed = "not held" if s.speed_Hz is None else f"{s.speed_Hz:g} Hz"
    when = f", reached in {answer.reached_in_s:.1f} s" if answer.reached_in_s else ""
    return (
        f"set: torque {s.target_Nm:g} Nm{when}; speed {speed}, brake {s.brake:.3g}, "
        f"drive {s.drive_Hz:g} Hz, compensation {s.compensate}"
    )


def show_reached(client: "Client", answer: "SetpointReply", for_s: float | None) -> None:
    """Wait until the torque is the one that was set, and print what the bench measures then.

    Not for longer than `for_s`, and else by the times of the states: this process may have been
    stopped meanwhile.
    """
    target_Nm = answer.setpoint.target_Nm
    if not answer.reached_in_s:
        return
    left_s, begun_s, state = answer.reached_in_s + LATE_S, time.monotonic(), None
    with client.subscribe_state() as states:
        while left_s > 0.0 and (for_s is None or time.monotonic() < begun_s + for_s):
            if (came := states.get(LOOK_S)) is None:
                left_s -= LOOK_S
                continue
            left_s -= (came.t_ns - (state or came).t_ns) * 1e-9
            state = came
            if _is_there(state, target_Nm) or state.state != "ENABLED":
                break
    if state is not None and state.tick is not None:
        print_line(_reached(state, target_Nm))


def _is_there(state: "BenchState", target_Nm: float) -> bool:
    return (
        state.tick is not None
        and state.setpoint.target_Nm == target_Nm == state.setpoint.torque_Nm
        and isclose(state.tick.torque_set_Nm or 0.0, target_Nm, rel_tol=SINGLE)
    )


def _reached(state: "BenchState", target_Nm: float) -> str:
    assert state.tick is not None
    when = "reached" if _is_there(state, target_Nm) else f"now, {state.state}"
    held_Hz, record = state.setpoint.speed_Hz, state.recording
    aim = f" of {held_Hz:g} Hz" if held_Hz is not None else ""
    unrecorded = record.error or (not record.recording and record.obstacle)
    return (
        f"{when}: torque {number(state.tick.torque_set_Nm)} Nm commanded, {sensor_text(state)}; "
        f"speed {number(state.tick.speed_Hz)} Hz{aim}"
        + (f"; {recording(state)}" if unrecorded else "")
    )
