"""The option --store, and what is stored of an analysis."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.console import fail, remark

if TYPE_CHECKING:
    import pyarrow as pa

    from motord.experiments.subject import Recordings

PLACE = "a folder, or a URL such as s3://BUCKET/FOLDER"

Store = Annotated[
    str | None,
    typer.Option(
        "--store",
        envvar="MOTORD_STORE",
        metavar="DIR",
        help=f"Add the result to this store: {PLACE}.",
    ),
]
StoreToRead = Annotated[
    str | None,
    typer.Option(
        "--store", envvar="MOTORD_STORE", metavar="DIR", help=f"The results store: {PLACE}."
    ),
]


class AnalysisStorage:
    """Where an analysis is to be stored, with its settings and what their files held before it.

    serial: of the motor, where its recordings do not know it. Raises ResultsError if nothing can be
    stored there: before the analysis, which may take long.
    """

    def __init__(
        self, store: str, experiment: str, settings: Mapping[str, Any], serial: str = ""
    ) -> None:
        from motord.results.store import ResultsStore

        self._store = ResultsStore(store)
        self._store.make()
        self._experiment = experiment
        self._serial = serial
        given = {name: value for name, value in settings.items() if value is not None}
        self._settings = {name: _setting(value) for name, value in given.items()}

    def add(self, content: Mapping[str, Any], recordings: "Recordings") -> None:
        """Store the JSON of a result, and say so on stderr. Raises ResultsError."""
        from importlib.metadata import version

        from motord.results.figures import figures
        from motord.results.recorded import recorded_digests, recorded_since
        from motord.results.stored_result import StoredResult, text_digest

        subject = recordings.subject
        settings = dict(self._settings)
        if "config" in settings:  # the bench file may name another one with the back-EMF
            table = subject.motor.back_emf_table()
            settings["config"] += f" back-emf:{text_digest(table.tolist())}"
        added = self._store.add(
            StoredResult(
                experiment=self._experiment,
                motor=subject.motor.name,
                serial=subject.motor.serial or self._serial,
                bench=subject.bench,
                run=", ".join(sorted(recordings.names)),
                time=recorded_since(recordings.runs),
                version=version("motord"),
                settings=settings,
                recordings=recorded_digests(recordings.runs),
                figures=figures(content),
            )
        )
        remark(added.in_words())


def _setting(value: Any) -> Any:
    """Return a setting as it is stored: of a file the digest of its content, which counts."""
    from motord.results.stored_result import file_digest

    return f"sha256:{file_digest(value)}" if isinstance(value, Path) else value


def named(store: str | None) -> str:
    """Return the store that was named; else the usage is wrong."""
    if store is None:
        raise typer.BadParameter("which store? --store DIR, or MOTORD_STORE")
    return store


class StoreReading:
    """The rows of a store, where what cannot be read ends the command with exit code 1."""

    def __init__(self, store: str | None) -> None:
        from motord.results.store import ResultsStore

        results = ResultsStore(named(store))
        self.folder = str(results.folder)
        contents = results.read()
        self.table: pa.Table = contents.table
        self._unreadable = contents.unreadable

    def finish(self) -> None:
        """Name what could not be read, if anything."""
        for line in self._unreadable[:-1]:
            remark(f"motord: {line}")
        for line in self._unreadable[-1:]:
            fail(line)
