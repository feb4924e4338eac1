"""`motord calibration export`: the compensation as a table for a drive."""

from math import fmod, isfinite, radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from motord.cli.calibration.in_force import CalibrationFile, load_in_force
from motord.cli.common_options import (
    AsJson,
    Overwrite,
    bench_file,
    bench_files,
    check_output_files,
    output_file,
)
from motord.cli.connection_options import DEFAULT, Connection
from motord.cli.console import fail, print_json, remark

if TYPE_CHECKING:
    from motord.calibration import Calibration
    from motord.calibration.export import TorqueConstant

Format = Literal["moteus", "odrive", "csv", "c-header", "beckhoff-harmonics"]


def export(
    format_: Annotated[Format, typer.Option("--format", help="Format of the drive's table.")],
    file: CalibrationFile = None,
    output: Annotated[Path | None, output_file("Write it there; default: print it.")] = None,
    config: Annotated[
        Path | None, bench_file("The bench: its back-EMF makes amperes of Nm.")
    ] = None,
    torque_constant: Annotated[
        float | None,
        typer.Option(
            metavar="NM_PER_A",
            min=1e-9,
            help="Torque constant of the drive: Nm per ampere (peak) along q.",
        ),
    ] = None,
    zero: Annotated[
        float,
        typer.Option(metavar="DEG", help="What the drive's encoder reads where the bench's is 0."),
    ] = 0.0,
    backwards: Annotated[
        bool, typer.Option("--backwards", help="The drive's angle falls when the bench's rises.")
    ] = False,
    length: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=4,
            max=1 << 20,
            help="Entries of the table (csv, c-header), by default 1024.",
        ),
    ] = None,
    bits: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=4, max=16, help="Bits of an entry (c-header), by default 16."
        ),
    ] = None,
    force: Overwrite = False,
    connection: Connection = DEFAULT,
    as_json: AsJson = False,
) -> None:
    """Write the cogging compensation of a calibration as a drive stores it.

    Prints the residual torque ripple with the drive's table, and what of the calibration the drive
    cannot take. Amperes, in moteus, csv and c-header, need the bench file or --torque-constant.
    """
    from motord.atomic_write import write_whole
    from motord.calibration.export import FORMATS, DriveFrame, exported

    if not isfinite(zero) or not isfinite(torque_constant or 0.0):
        raise typer.BadParameter("--zero and --torque-constant have to be finite")
    check_output_files({"--output": output}, [file, *bench_files(config)])
    if output is not None and output.exists() and not force:
        fail(f"{output}: is there already; name another file, or say --force to write over it")
    drive_format = FORMATS[format_].resized(length, bits)
    calibration = _calibration(file, connection)
    constant = _constant(calibration, config, torque_constant)
    made = exported(
        calibration, drive_format, DriveFrame(radians(fmod(zero, 360)), backwards), constant
    )
    content = made.content()
    if output is None:
        content["content"] = made.text()
    else:
        write_whole(output, made.text())
        content["file"] = str(output)
    if as_json:
        print_json(content)
    else:
        for line in made.lines():
            remark(line)
        typer.echo(made.text() if output is None else str(output), nl=output is not None)


def _calibration(file: Path | None, connection: Connection) -> "Calibration":
    """Return the calibration of a file, or that in force. Raises CalibrationError."""
    from motord.calibration import load

    if file is not None:
        return load(file)
    with connection.connect() as client:
        return load_in_force(client)


def _constant(
    calibration: "Calibration", config: Path | None, torque_constant: float | None
) -> "TorqueConstant | None":
    """Return the torque of an ampere as the options say it. Raises CalibrationError, ConfigError.

    That of the bench file is over the turn, with the common gain that the calibration found.
    """
    import numpy as np

    from motord.calibration.export import TorqueConstant, torque_per_ampere
    from motord.config import load

    if config is None:
        if torque_constant is None:
            return None
        return TorqueConstant(np.full(calibration.motor.counts, torque_constant))
    motor = load(config).motor
    calibration.check_motor(motor)
    of_motor = torque_per_ampere(motor.back_emf_table(), motor.pole_pairs)
    return TorqueConstant(calibration.delta_epsilon * of_motor, torque_constant)
