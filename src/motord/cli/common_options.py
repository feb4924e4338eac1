"""Options that commands have in common, and the check of the files that they name.

Those of a connection are in `connection_options`.
"""

import os
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from motord.cli.console import fail


def bench_file(meaning: str) -> Any:
    """Return the option --config, -c of a command to which it means this."""
    return typer.Option("--config", "-c", metavar="FILE", help=meaning)


def output_file(meaning: str, metavar: str = "FILE") -> Any:
    """Return the option --output, -o of a command to which it means this."""
    return typer.Option("--output", "-o", metavar=metavar, help=meaning)


AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
ResultAsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
ReadyAsJson = Annotated[bool, typer.Option("--json", help="Print one line of JSON when ready.")]
Overwrite = Annotated[bool, typer.Option("--force", help="Write over a file that is there.")]
BenchFile = Annotated[Path | None, bench_file("The bench; without it, the simulated one.")]
PlanSettings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change a setting, e.g. torques_Nm=1,3."),
]
Detach = Annotated[
    bool, typer.Option("--detach", help="Return at once; the daemon goes on by itself.")
]
Check = Annotated[
    bool,
    typer.Option(
        "--check/--no-check",
        help="Check the calibration before, if the bench file asks for it (check_before_plans).",
    ),
]
Notes = Annotated[str, typer.Option(help="Notes for the recording.")]
Serial = Annotated[
    str | None,
    typer.Option(
        metavar="S",
        help="The motor's serial number, for the recording, where the bench file names none.",
    ),
]


NO_RESULTS = {".mcap": "recording", ".part": "unfinished file", ".toml": "TOML file"}
"""What no result is written over, by the end of its name: there may be no other copy of it."""


def check_output_files(
    written: Mapping[str, Path | None],
    read: Iterable[Path | None],
    edited: Collection[str] = (),
) -> None:
    """Refuse, before there is anything to write, what would write over a file of this command.

    Or over one that is no result. written: by option; edited: options whose file is not replaced.
    Devices and pipes take whatever comes. Raises typer.BadParameter; fails if there is no folder to
    write to, if it may not be written to, or if the file is one.
    """
    inputs = {_identity(path): path for path in read if path is not None}
    options: dict[object, str] = {}
    for option, path in written.items():
        if path is None or (path.exists() and not (path.is_file() or path.is_dir())):
            continue
        identity = _identity(path)
        if identity in inputs:
            raise typer.BadParameter(
                f"{option} {path}: this command reads {inputs[identity]}, which would be lost; "
                "name another file"
            )
        if identity in options:
            raise typer.BadParameter(
                f"{option} {path}: {options[identity]} writes the same file; name another one"
            )
        options[identity] = option
        if path.is_file() and option not in edited and path.suffix in NO_RESULTS:
            raise typer.BadParameter(
                f"{option} {path}: is a {NO_RESULTS[path.suffix]}, which would be lost; "
                "name another file"
            )
        if path.is_dir():
            fail(f"{option} {path}: is a folder; name a file")
        if not (folder := path.absolute().parent).is_dir():
            fail(f"{option} {path}: there is no folder {folder}; make it")
        if not os.access(Path(os.path.realpath(path)).parent, os.W_OK):
            fail(f"{option} {path}: no permission to write there; name a file in another folder")


def bench_files(config: Path | None) -> list[Path]:
    """Return a bench or motor file, and the files that it names; none if it is None."""
    from motord.config import ConfigError, read_toml
    from motord.config.named_files import named_files, resolve

    if config is None:
        return []
    try:
        _, content = read_toml(config)
    except ConfigError:  # whoever loads it says what is wrong
        return [config]
    return [config, *(resolve(config, Path(name)) for _, _, name in named_files(content))]


def _identity(path: Path) -> object:
    """Return what is the same for all names of a file, also for one that is not there yet."""
    try:
        found = path.stat()
    except OSError:
        return os.path.realpath(path)
    return found.st_dev, found.st_ino
