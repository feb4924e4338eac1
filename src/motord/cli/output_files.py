"""The files that a command writes: none that it reads, no file twice, each in a folder."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

import typer

from motord.cli.console import fail


def check_output_files(written: Mapping[str, Path | None], read: Iterable[Path | None]) -> None:
    """Refuse, before there is anything to write, what would write over a file of this command.

    written: by option. Devices and pipes take whatever comes. Raises typer.BadParameter; fails if
    there is no folder to write to.
    """
    inputs = {_identity(path): path for path in read if path is not None}
    options: dict[object, str] = {}
    for option, path in written.items():
        if path is None or (path.exists() and not path.is_file()):
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
        if not path.absolute().parent.is_dir():
            fail(f"{option} {path}: there is no folder {path.absolute().parent}; make it")


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
