"""`motord status|watch|events|enable|disable|stop|reset|set`: watch and operate a bench by hand."""

from enum import StrEnum
from typing import Annotated, Any

import typer

from motord.cli.command import Command, hold, in_command
from motord.cli.observe import events, status, watch
from motord.cli.reach import ENDPOINT, AsJson, Bench, Connect, Force, daemon, say

__all__ = ["disable", "enable", "events", "reset", "set_", "status", "stop", "watch"]

ForS = Annotated[
    float | None,
    typer.Option("--for-s", min=0, metavar="S", help="Stay in command this long only."),
]


class Compensate(StrEnum):
    """What of the installed calibration is applied."""

    OFF = "off"
    ON = "on"
    CALIBRATION = "calibration"
    CURRENTS = "currents"
    COGGING = "cogging"


def enable(
    bench: Bench = None,
    connect: Connect = ENDPOINT,
    for_s: ForS = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Enable at zero torque, and stay in command.

    While it runs, `motord set` in another terminal sets torque and speed. When it ends, the bench
    ramps down and is disabled.
    """
    with daemon(bench, connect) as client, in_command(client, force=force) as command:
        answer = client.rpc("enable", token=command.token)
        say(answer, answer["state"], as_json)
        if command.lease is not None:
            hold(client, command.lease, for_s, quiet=as_json)


def disable(
    bench: Bench = None, connect: Connect = ENDPOINT, force: Force = False, as_json: AsJson = False
) -> None:
    """Ramp the torque to zero, then disable; ends a plan."""
    with daemon(bench, connect) as client, in_command(client, force=force) as command:
        answer = client.rpc("disable", token=command.token)
        say(answer, answer["state"], as_json)


def stop(bench: Bench = None, connect: Connect = ENDPOINT, as_json: AsJson = False) -> None:
    """Zero current now and OFF, whoever is in command."""
    from motord.client import operator

    with daemon(bench, connect) as client:
        answer = client.rpc("stop", by=operator())
        say(answer, answer["state"], as_json)


def reset(
    bench: Bench = None, connect: Connect = ENDPOINT, force: Force = False, as_json: AsJson = False
) -> None:
    """Leave a trip whose cause is gone; start the loop again if it has ended."""
    with daemon(bench, connect) as client, in_command(client, force=force) as command:
        answer = client.rpc("reset", token=command.token)
        say(answer, answer["state"], as_json)


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
        Compensate | None, typer.Option(help="What of the calibration is applied.")
    ] = None,
    enable_first: Annotated[bool, typer.Option("--enable", help="Enable first.")] = False,
    bench: Bench = None,
    connect: Connect = ENDPOINT,
    for_s: ForS = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Set torque, speed, brake or drive; what is left out stays as it is.

    Ends at once if another command (`motord enable`) is in command, else stays in command itself.
    """
    given: dict[str, Any] = {
        "torque_Nm": torque_Nm,
        "speed_Hz": speed_Hz,
        "brake": brake,
        "drive_Hz": drive_Hz,
        "compensate": compensate.value if compensate is not None else None,
    }
    asked = {key: value for key, value in given.items() if value is not None}
    if not asked:
        raise typer.BadParameter("nothing to set: give at least one of the options above")
    with daemon(bench, connect) as client, in_command(client, force=force) as command:
        if enable_first:
            client.rpc("enable", token=command.token)
        answer = client.rpc("set", token=command.token, **asked)
        say(answer, _in_words(answer["setpoint"]), as_json)
        if _moves(command, asked):
            assert command.lease is not None
            hold(client, command.lease, for_s, quiet=as_json)


def _moves(command: Command, asked: dict[str, Any]) -> bool:
    """Return whether what was set lasts only as long as this command holds the lease."""
    return command.lease is not None and asked.keys() != {"compensate"}


def _in_words(setpoint: dict[str, Any]) -> str:
    speed = "not held" if setpoint["speed_Hz"] is None else f"{setpoint['speed_Hz']:g} Hz"
    return (
        f"torque {setpoint['torque_Nm']:g} Nm, speed {speed}, brake {setpoint['brake']:.3g}, "
        f"drive {setpoint['drive_Hz']:g} Hz, compensation {setpoint['compensate']}"
    )
