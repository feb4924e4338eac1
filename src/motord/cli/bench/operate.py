"""`motord enable|disable|stop|reset|set|note`: manual operation of a bench."""

import time
from contextlib import suppress
from operator import attrgetter, methodcaller
from typing import Annotated, Any, Literal

import typer

from motord.cli.bench.lease_session import announce, command, hold, in_command
from motord.cli.bench.set_report import set_text, show_reached
from motord.cli.common_options import AsJson
from motord.cli.connection_options import DEFAULT, Connection, Force, print_answer

ForS = Annotated[
    float | None,
    typer.Option("--for-s", min=0, metavar="S", help="Stay in command this long only."),
]

CompensateOption = Literal["off", "on", "calibration", "currents", "cogging"]
"""`motord.sequencing.settings.Compensation`, without loading it."""


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
    """Leave a trip whose cause is gone; start the loop again if it has ended."""
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
