"""The option --store, and what is stored of an analysis."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.console import fail_with, remark

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
        from motord.batch.stored import settings_to_store
        from motord.results.store import ResultsStore

        self._store = ResultsStore(store)
        self._store.make()
        self._experiment = experiment
        self._serial = serial
        self._settings = settings_to_store(settings)

    def add(self, content: Mapping[str, Any], recordings: "Recordings") -> None:
        """Store the JSON of a result, and say so on stderr. Raises ResultsError."""
        from motord.batch.stored import stored_result

        result = stored_result(self._experiment, self._settings, content, recordings, self._serial)
        remark(self._store.add(result).to_text())


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
        fail_with(self._unreadable)
