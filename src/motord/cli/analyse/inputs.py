"""What the kinds of analysis share: options, opening of recordings, errors in one line."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from motord.cli.console import fail

if TYPE_CHECKING:
    from motord.experiments.subject import Subject
    from motord.recording.reader import Run

Runs = Annotated[list[Path], typer.Argument(metavar="RUN...", help="Recordings, .mcap.")]
Output = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write the result, JSON.")
]
Report = Annotated[
    Path | None, typer.Option("--report", metavar="FILE", help="Write a page with pictures, HTML.")
]
BenchFile = Annotated[
    Path | None,
    typer.Option(
        "--config", "-c", metavar="FILE",
        help="Bench file or motor file; without it, what the recordings say of themselves.",
    ),
]  # fmt: skip
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


@contextmanager
def explained() -> Iterator[None]:
    """Turn what can be wrong with the files or the data into one line on stderr."""
    from motord.calibration import CalibrationError
    from motord.config import ConfigError
    from motord.experiments.subject import AnalysisError
    from motord.identification import IdentifyError
    from motord.recording.errors import RecordError

    try:
        yield
    except (AnalysisError, CalibrationError, ConfigError, IdentifyError, RecordError) as error:
        fail(str(error))
    except OSError as error:
        fail(f"{error.filename}: {error.strerror}")


def open_runs(paths: list[Path], config: Path | None) -> "tuple[list[Run], Subject]":
    """Open recordings; return them and what they are of."""
    from motord.experiments.subject import Subject
    from motord.recording.reader import open_run

    runs = [open_run(path) for path in paths]
    return runs, Subject.of_file(config) if config else Subject.of_runs(runs)


def say_files(*files: Path | None) -> None:
    """Print which files were written."""
    for file in files:
        if file is not None:
            typer.echo(f"wrote {file}")
