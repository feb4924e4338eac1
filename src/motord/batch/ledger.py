"""What became of each analysis: the file of the store that has its result, or why there is none."""

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from motord.atomic_write import write_cached
from motord.results.error import ResultsError
from motord.results.folders.folder import LocalFolder
from motord.results.parquet_file import ResultFile
from motord.results.store import ResultsStore
from motord.untrusted import parse_json

FOLDER = ".ledger"
"""In the results store, which passes over it."""


@dataclass(frozen=True)
class LedgerEntry:
    """One analysis of one recording. stored: name of the file in the store; failure: the reason.

    One of the two is not empty. recording, sha256, experiment, version and settings are for people;
    the entry is found by their digest.
    """

    recording: str
    sha256: str
    experiment: str
    version: str
    settings: Mapping[str, Any]
    stored: str = ""
    failure: str = ""


class Ledger:
    """Entries in a folder of the store, a file each, replaced whole.

    A result is stored before it is entered, and an entry counts only while its result is there. So
    whoever is killed in between analyses again, and the store finds the result to be there already.
    For the same reason entries are not synced: one that a loss of power damaged is made again.
    Raises ResultsError for a store at a URL.
    """

    def __init__(self, store: ResultsStore) -> None:
        if not isinstance(store.folder, LocalFolder):
            raise ResultsError(
                f"{store.folder}: results of many recordings go into a folder of this computer, "
                "which keeps the ledger of what is done; copy it to an object store afterwards"
            )
        self._store = store
        self.folder = store.folder.path / FOLDER

    def make(self) -> None:
        """Make store and ledger. Raises ResultsError, OSError."""
        self._store.make()
        self._store.list_once()
        self.folder.mkdir(exist_ok=True)

    def find(self, analysis: LedgerEntry) -> LedgerEntry | None:
        """Return what became of an analysis; None if it is to be made."""
        with suppress(OSError, ValueError, TypeError):
            entry = LedgerEntry(**parse_json(self._path(analysis).read_bytes()))
            if entry.failure or (entry.stored and self._store.has(entry.stored)):
                return entry
        return None

    def store(self, analysis: LedgerEntry, file: ResultFile) -> str:
        """Store a result and enter it; return its file's name. Raises ResultsError, OSError."""
        name = Path(self._store.add_file(file).path).name
        self.enter(analysis, stored=name)
        return name

    def enter(self, analysis: LedgerEntry, **outcome: str) -> None:
        """Enter `stored` or, if there is no result, `failure`. Raises OSError."""
        content = {**asdict(analysis), "settings": dict(analysis.settings), **outcome}
        lines = json.dumps(content, separators=(",\n ", ": "))
        write_cached(self._path(analysis), f"{lines}\n")

    def _path(self, analysis: LedgerEntry) -> Path:
        of = (analysis.sha256, analysis.experiment, analysis.version, dict(analysis.settings))
        digest = hashlib.sha256(json.dumps(of, sort_keys=True).encode()).hexdigest()
        return self.folder / f"{digest}.json"
