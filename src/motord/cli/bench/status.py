"""`motord status`, `watch`, `events`: what a bench does, now and as it goes on."""

import time
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from typing import TYPE_CHECKING, Annotated

import typer

from motord.cli.common_options import AsJson
from motord.cli.connection_options import DEFAULT, Connection
from motord.cli.console import nobody_reads, plain_console, print_line

if TYPE_CHECKING:
    from rich.table import Table

    from motord.api.messages import BenchState, Event
    from motord.client import Client

LOOK_S = 1.0

ForS = Annotated[
    float | None, typer.Option("--for-s", min=0, metavar="S", help="End after this time.")
]


def status(connection: Connection = DEFAULT, as_json: AsJson = False) -> None:
    """Show the state now."""

    with connection.open() as client:
        state = client.state()
        if as_json:
            typer.echo(state.model_dump_json(indent=2))
        else:
            show(state)


def watch(connection: Connection = DEFAULT, for_s: ForS = None, as_json: AsJson = False) -> None:
    """Show the state as it changes, until Ctrl-C; with --json one line each."""
    from rich.live import Live

    with connection.open() as client, suppress(KeyboardInterrupt):
        if as_json:
            _each_state(client, for_s, lambda state: print_line(state.model_dump_json()))
        else:
            with Live(
                table(client.state()), console=plain_console(), refresh_per_second=10
            ) as live:
                _each_state(client, for_s, lambda state: live.update(table(state)))


def _each_state(
    client: "Client", for_s: float | None, show: "Callable[[BenchState], None]"
) -> None:
    from motord.client import ClientError

    end_s = None if for_s is None else time.monotonic() + for_s
    with client.subscribe_state() as states:
        while (end_s is None or time.monotonic() < end_s) and not nobody_reads():
            state = states.get(LOOK_S)
            if state is None:
                raise ClientError("unreachable", f"bench {client.bench} is silent: has it ended?")
            show(state)


def events(
    connection: Connection = DEFAULT,
    follow: Annotated[bool, typer.Option(help="Go on with new ones, until Ctrl-C.")] = True,
    as_json: AsJson = False,
) -> None:
    """Show the latest events, then new ones as they happen."""
    with (
        connection.open() as client,
        client.subscribe_events() as coming,
        suppress(KeyboardInterrupt),
    ):
        shown_ns = 0
        for event in client.events():
            _show(event, as_json)
            shown_ns = event.t_ns
        while follow and not nobody_reads():
            new = coming.get(LOOK_S)
            if new is None:
                client.state()  # to notice that the daemon is gone
            elif new.t_ns > shown_ns:
                _show(new, as_json)


def _show(event: "Event", as_json: bool) -> None:
    if as_json:
        print_line(event.model_dump_json())
        return
    moment = datetime.fromtimestamp(event.t_ns / 1e9).astimezone()
    stamp = f"{moment:%Y-%m-%d %H:%M:%S.%f}"[:-3]
    print_line(f"{stamp} {event.kind}: {event.message}")
    if event.kind == "trip":
        data = event.data
        print_line(f"{'':>{len(stamp)}} suggested: {data.get('action', '-')}; then `motord reset`")
        if data.get("blackbox"):
            print_line(f"{'':>{len(stamp)}} black box: {data['blackbox']}")


def show(state: "BenchState") -> None:
    """Print a state; where it is no terminal, whatever its lines are long."""
    console = plain_console()
    if not console.is_terminal:
        console.width = 500
    console.print(table(state))


def table(state: "BenchState") -> "Table":
    """Return a state as two columns."""
    from rich.table import Table

    rows = Table(show_header=False, box=None, pad_edge=False)
    rows.add_column(style="dim")
    rows.add_column()
    for name, value in _rows(state):
        rows.add_row(name, value)
    return rows


def _rows(state: "BenchState") -> list[tuple[str, str]]:
    rows = [("bench", f"{state.bench}, {state.motor}" + (", simulated" * state.simulated))]
    rows.append(("state", state.state))
    if state.fault:
        rows.append(("fault", state.fault))
    process = state.processes.get("loop")
    if state.fault and process is not None and not process.running:
        rows.append(("then", "`motord reset` starts the loop again"))
    rows += _trip(state)
    rows += _measured(state)
    holder = state.lease.holder
    rows.append(("command", f"{holder}" if holder else "nobody"))
    if state.plan is not None:
        p = state.plan
        step = "" if p.over else f", {p.step}"
        rows.append(("plan", f"{p.plan} {p.state}, {p.points_done}/{p.points} points{step}"))
    c = state.calibration
    rows.append(("calibration", f"{c.id}, {c.method}, {c.age} old" if c is not None else "none"))
    recording = state.recording
    trouble = recording.error or recording.obstacle
    idle = f"not recording: {trouble}" if trouble else "not recording"
    rows.append(("recording", recording.path if recording.recording else idle))
    rows += [("fault", said) for said in state.faults.values()]
    loop = state.loop
    rows.append(
        (
            "loop",
            f"{loop.rate_Hz:g} Hz, {loop.missed} missed of {loop.ticks}, "
            f"late {number(loop.wake_late_us_p50)} us (99 %: {number(loop.wake_late_us_p99)}), "
            f"work {number(loop.work_us_p99)} us",
        )
    )
    if state.realtime and not state.realtime.get("granted", True):
        rows.append(("real time", "not all rights granted: `motord check --rt` says which"))
    if (clock := state.bridge_clock) is not None:
        words = f"drift {clock.drift_ppm:.1f} ppm, jitter {clock.jitter_us:.0f} us"
        rows.append(("bridge clock", words))
    for name, device in (("brake", state.brake), ("drive", state.drive)):
        rows.append((name, device.health + (f": {device.error}" if device.error else "")))
    return rows


def _trip(state: "BenchState") -> list[tuple[str, str]]:
    """Return causes (the first one first), values and limits, what to do, and the black box."""
    causes = sorted(state.trips, key=lambda trip: trip.name != state.first_trip)
    rows = [("cause", f"{trip.name}: {trip.meaning}") for trip in causes]
    if state.trip is None:
        return rows
    for what, value in state.trip.values.items():
        rows.append(("", f"{what}: {number(value.value)}, limit {number(value.limit)}"))
    rows.append(("suggested", f"{state.trip.action}; then `motord reset`"))
    if state.trip.blackbox:
        rows.append(("black box", state.trip.blackbox))
    return rows


def sensor_in_words(state: "BenchState") -> str:
    """Return what the torque sensor says, and that it says nothing of the mean if so."""
    tick, sensor = state.tick, state.torque_sensor
    measured = number(tick.torque_Nm if tick is not None else None)
    if sensor.passes_mean:
        return f"{measured} Nm measured"
    ripple = number(tick.torque_ripple_Nm if tick is not None else None)
    return (
        f"{measured} Nm measured without the mean, which this sensor does not pass (high-pass, "
        f"{sensor.highpass_time_constant_s:g} s); ripple {ripple} Nm RMS over the last second"
    )


def _measured(state: "BenchState") -> list[tuple[str, str]]:
    tick = state.tick
    if tick is None:
        return []
    wanted = state.setpoint
    target_Nm = wanted.torque_Nm if wanted.torque_target_Nm is None else wanted.torque_target_Nm
    speed = f"of {wanted.speed_Hz:g} Hz" if wanted.speed_Hz is not None else "Hz"
    currents = ", ".join(number(i) for i in tick.i_A)
    return [
        ("torque", f"{number(tick.torque_set_Nm)} of {target_Nm:g} Nm set, "
                   f"{sensor_in_words(state)}"),
        ("speed", f"{number(tick.speed_Hz)} {speed}"),
        ("currents", f"{currents} A"),
        ("bus", f"{number(tick.u_bus_V)} V, inverter {number(tick.temperature_C)} degC"),
    ]  # fmt: skip


def number(value: float | None) -> str:
    """Return a number in three digits, "-" for none."""
    return "-" if value is None else f"{value:.3g}"
