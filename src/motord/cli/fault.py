"""`motord fault`: faults for an emulated bench, by command."""

from pathlib import Path
from typing import Annotated, Any

import typer

from motord.cli.common_options import AsJson, bench_file
from motord.cli.console import fail, group, print_result
from motord.cli.plan.settings import value_of

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
