"""`motord emulate` and `motord fault`: the devices of a bench on the wire, and their faults."""

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.common_options import AsJson, bench_file
from motord.cli.connection_options import print_answer
from motord.cli.console import fail, group, print_result
from motord.cli.plan.settings import value_of
from motord.process.collector_pause import collector_paused
from motord.process.signal_handlers import INTERRUPTS, handled

if TYPE_CHECKING:
    from motord.recording.writer import RunWriter


def emulate(
    config: Annotated[Path, bench_file("The bench whose devices are emulated.")],
    truth: Annotated[
        Path | None,
        typer.Option(metavar="FILE.mcap", help="Record what the rig truly does."),
    ] = None,
    faults: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="A timeline of faults, instead of the bench file's."),
    ] = None,
    firmware: Annotated[
        Path | None,
        typer.Option(metavar="FILE.elf", help="Let QEMU run this image as the bridge board."),
    ] = None,
    duration_s: Annotated[
        float | None, typer.Option("--duration-s", min=0, help="End after this time.")
    ] = None,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Lines of JSON: when ready, each fault, at the end."),
    ] = False,
) -> None:
    """Emulate the devices of a bench on the wire: inverter, bridge, brake and external drive."""
    with collector_paused():
        from motord.config import load
        from motord.config.faults import load_timeline
        from motord.emulate.process import Emulator
        from motord.rig.truth import load as load_rig

    bench = load(config)
    with _truth_writer(truth, bench.bench.name) as writer:
        timeline = load_timeline(faults) if faults else None
        rig = load_rig(bench.bench.rig)
        emulator = Emulator(
            bench,
            rig,
            writer.truth if writer is not None else None,
            timeline,
            lambda fault: print_answer(fault, _fault_line(fault), as_json),
            firmware,
        )
        ends = handled(INTERRUPTS, lambda *_: emulator.stop())
        with ends, emulator:
            print_answer(emulator.ready(), _ready_line(emulator.ready()), as_json)
            emulator.run(duration_s)
    print_answer(emulator.summary(), _summary_line(emulator.summary()), as_json)


def _truth_writer(truth: Path | None, bench: str) -> "AbstractContextManager[RunWriter | None]":
    if truth is None:
        return nullcontext()
    from motord.recording.writer import RunWriter

    return RunWriter(truth, {"bench": bench, "source": "motord emulate"})


def _ready_line(ready: dict[str, object]) -> str:
    modbus = ready["modbus"]
    assert isinstance(modbus, dict)
    places = "".join(f", {name} on {place}" for name, place in modbus.items())
    return (
        f"ready: bench {ready['bench']}, inverter on CAN {ready['can']}, "
        f"bridge on {ready['bridge']} ({ready['pty']}){places}"
    )


def _fault_line(fault: dict[str, object]) -> str:
    parts = ", ".join(f"{name} {value}" for name, value in fault.items() if name != "kind")
    return f"fault: {fault['kind']}, {parts}"


def _summary_line(summary: dict[str, object]) -> str:
    mean_Nm = summary["torque_mean_Nm"]
    torque = f"{mean_Nm:.4g} Nm" if isinstance(mean_Nm, float) else "never switched on"
    return (
        f"ended: {summary['ticks']} ticks, true mean torque {torque}, "
        f"{summary['command_timeouts']} command timeouts, "
        f"{summary['heartbeat_drops']} heartbeat drops"
    )


app = group("Inject faults into an emulated bench.")


@app.command()
def inject(
    kind: Annotated[str, typer.Argument(help="What happens; see `motord fault kinds`.")],
    parameters: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME=VALUE]...", help="Its parameters.")
    ] = None,
    config: Annotated[Path | None, bench_file("The bench that is emulated.")] = None,
    for_s: Annotated[
        float | None, typer.Option("--for-s", min=0, help="How long; else as its kind does.")
    ] = None,
    at_s: Annotated[float, typer.Option("--at-s", min=0, help="How long from now.")] = 0.0,
    as_json: AsJson = False,
) -> None:
    """Inject a fault into the running emulator of a bench."""
    from motord.config import load
    from motord.config.faults import Fault
    from motord.emulate.control import inject as send

    wanted: dict[str, Any] = {"kind": kind, "at_s": at_s}
    if for_s is not None:
        wanted["for_s"] = for_s
    for parameter in parameters or ():
        name, equals, value = parameter.partition("=")
        if not equals:
            fail(f"{parameter!r} is not NAME=VALUE")
        wanted[name] = value_of(value)
    injected = send(load(config), wanted)
    fault = Fault.model_validate({key: injected[key] for key in injected if key != "ok"})
    print_result(injected, f"injected: {fault.summary()}", as_json)


@app.command()
def kinds(as_json: AsJson = False) -> None:
    """List the kinds of faults and their parameters."""
    from motord.config.faults import KINDS

    result, lines = {}, []
    for name, kind in KINDS.items():
        result[name] = {**vars(kind), "places": sorted(kind.places)}
        parameters = " ".join(f"{key}={value}" for key, value in kind.parameters.items())
        lines.append(f"{name:18} {kind.meaning}" + (f" [{parameters}]" if parameters else ""))
    print_result(result, "\n".join(lines), as_json)
