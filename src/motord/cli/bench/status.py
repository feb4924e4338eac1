"""`motord status` and `motord events`: what a bench does now, and what happened."""

from contextlib import suppress
from typing import TYPE_CHECKING, Annotated

import typer

from motord.cli.bench import wording
from motord.cli.bench.overview import All, events_of_all, status_of_all
from motord.cli.bench.wording import number
from motord.cli.common_options import AsJson
from motord.cli.connection_options import DEFAULT, Connection
from motord.cli.console import plain_console, print_line
from motord.process.standard_streams import nobody_reads

if TYPE_CHECKING:
    from rich.table import Table

    from motord.api.messages import BenchState, Event

LOOK_S = 1.0


def status(
    connection: Connection = DEFAULT, all_benches: All = False, as_json: AsJson = False
) -> None:
    """Show the state now; of all benches, a line each (with --json one object a line)."""
    if all_benches:
        status_of_all(connection, as_json=as_json)
        return
    with connection.connect() as client:
        state = client.state()
        if as_json:
            print_line(state.model_dump_json(indent=2))
        else:
            show(state)


def events(
    connection: Connection = DEFAULT,
    follow: Annotated[bool, typer.Option(help="Go on with new ones, until Ctrl-C.")] = True,
    all_benches: All = False,
    as_json: AsJson = False,
) -> None:
    """Show the latest events, then new ones as they happen; of all benches only new ones."""
    if all_benches:
        if not follow:
            raise typer.BadParameter("--all shows new events only: leave --no-follow out")
        events_of_all(connection, as_json=as_json)
        return
    with (
        connection.connect() as client,
        client.subscribe_events() as coming,
        suppress(KeyboardInterrupt),
    ):
        shown = client.events()
        for event in shown:
            _show(event, as_json)
        while follow and not nobody_reads():
            new = coming.get(LOOK_S)
            if new is None:
                client.state()  # to notice that the daemon is gone
            elif new not in shown:  # not by its time: clocks are set back
                _show(new, as_json)


def _show(event: "Event", as_json: bool) -> None:
    if as_json:
        print_line(event.model_dump_json())
        return
    stamp = wording.moment(event.t_ns)
    print_line(f"{stamp} {event.kind}: {event.message}")
    if event.kind == "trip":
        data = event.data
        print_line(f"{'':>{len(stamp)}} suggested: {data.get('action', '-')}; then `motord reset`")
        if data.get("blackbox"):
            print_line(f"{'':>{len(stamp)}} black box: {data['blackbox']}")


def show(state: "BenchState") -> None:
    """Print a state; where it is no terminal each row is one line, whatever its length."""
    console = plain_console()
    if console.is_terminal:
        console.print(table(state))
        return
    rows = _rows(state)
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        print_line(f"{name:<{width}}  {value}".rstrip())


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
    if state.remedy:
        rows.append(("then", state.remedy))
    rows += _trip(state)
    rows += _measured(state)
    rows.append(("lease", state.lease.holder or "nobody"))
    if (plan := state.plan) is not None:
        rows.append(("plan", f"{plan.plan} {plan.state}, {wording.plan_progress(plan)}"))
    if state.queue is not None and (state.queue.length or state.queue.active):
        rows.append(("queue", wording.queue(state.queue)))
    rows.append(("calibration", wording.calibration(state)))
    if state.tracking is not None:
        rows.append(("tracked", wording.tracked(state.tracking, state.t_ns)))
    rows.append(("recording", wording.recording(state)))
    rows += [("fault", fault_text) for fault_text in state.faults.values()]
    rows.append(("loop", wording.loop(state)))
    if state.realtime and not state.realtime.get("granted", True):
        rows.append(("real time", "not all rights granted: `motord check --rt` says which"))
    if state.links is not None and state.links.bridge:
        rows.append(("bridge", state.links.bridge))
    if (clock := state.bridge_clock) is not None:
        text = f"drift {clock.drift_ppm:.1f} ppm, jitter {clock.jitter_us:.0f} us"
        rows.append(("bridge clock", text))
    for name, device in (("brake", state.brake), ("drive", state.drive)):
        rows.append((name, device.health + (f": {device.error}" if device.error else "")))
    rows += [(one.name, wording.channel(one)) for one in state.channels]
    return rows


def _trip(state: "BenchState") -> list[tuple[str, str]]:
    """Return causes (the first one first), values and limits, what to do, and the black box."""
    rows = [("cause", cause) for cause in wording.causes(state)]
    if state.trip is None:
        return rows
    rows += [("", value) for value in wording.trip_values(state)]
    rows.append(("suggested", wording.suggestion(state)))
    if state.trip.blackbox:
        rows.append(("black box", state.trip.blackbox))
    return rows


def sensor_text(state: "BenchState") -> str:
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
    speed = f"of {wanted.speed_Hz:g} Hz" if wanted.speed_Hz is not None else "Hz"
    currents = ", ".join(number(i) for i in tick.i_A)
    return [
        ("torque", f"{number(tick.torque_set_Nm)} of {wanted.target_Nm:g} Nm set, "
                   f"{sensor_text(state)}"),
        ("speed", f"{number(tick.speed_Hz)} {speed}"),
        ("currents", f"{currents} A"),
        ("bus", f"{number(tick.u_bus_V)} V, inverter {number(tick.temperature_C)} degC"),
    ]  # fmt: skip
