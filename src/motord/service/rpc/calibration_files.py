"""RPCs that show calibrations: those kept on disk, and what is in one of them.

Files are read by a process of their own, each once; the supervisor gets what was read.
"""

import threading
from collections.abc import Callable
from pathlib import Path

from motord.api import requests as rpc
from motord.api.errors import RpcError
from motord.api.replies import CalibrationDetails, CalibrationEntry, CalibrationList
from motord.service.bench.calibrations import CalibrationStore
from motord.service.rpc.calibration_reader import ReadFiles, aged, read_files_elsewhere
from motord.service.rpc.dispatcher import RpcContext, handles

FILES_MAX = 200
"""Files that are listed: the newest ones."""

_Known = tuple[int, int]
"""Time of the last change (ns) and size of a file that was read."""


class CalibrationFiles:
    """Lists and shows the calibrations of `store`; what was read of a file is kept."""

    def __init__(self, store: CalibrationStore, read: ReadFiles = read_files_elsewhere) -> None:
        self._store = store
        self._read = read
        self._lock = threading.Lock()  # both requests have a thread
        self._found: dict[Path, tuple[_Known, CalibrationDetails | str]] = {}

    def prepare_list(
        self, payload: bytes
    ) -> tuple[rpc.NoArguments, dict[Path, CalibrationDetails | str]]:
        """Read the files that are new; for a thread that may wait. Raises RpcError."""
        return rpc.parse(rpc.CALIBRATION_LIST, payload), self._look()

    @handles(rpc.CALIBRATION_LIST)
    def list(self, request: rpc.NoArguments, context: RpcContext) -> CalibrationList:
        """Return the calibrations that are kept, the newest first."""
        found: dict[Path, CalibrationDetails | str] = context.prepared
        read = [one for one in found.values() if isinstance(one, CalibrationDetails)]
        in_force = self._store.current_id()
        fields = set(CalibrationEntry.model_fields)
        return CalibrationList(
            calibrations=[
                CalibrationEntry.model_validate(aged(one, in_force).model_dump(include=fields))
                for one in sorted(read, key=lambda one: one.created, reverse=True)
            ],
            unreadable=[why for why in found.values() if isinstance(why, str)],
        )

    def prepare_show(
        self, payload: bytes
    ) -> tuple[rpc.CalibrationShow, Callable[[str], CalibrationDetails]]:
        """Read the files that are new; for a thread that may wait. Raises RpcError."""
        request, found = rpc.parse(rpc.CALIBRATION_SHOW, payload), self._look()

        def of(calibration_id: str) -> CalibrationDetails:
            for one in found.values():
                if isinstance(one, CalibrationDetails) and one.id == calibration_id:
                    return one
            raise RpcError(
                "refused",
                f"no calibration {calibration_id} is kept; `motord calibration list` has those "
                "there are",
            )

        return request, of

    @handles(rpc.CALIBRATION_SHOW)
    def show(self, request: rpc.CalibrationShow, context: RpcContext) -> CalibrationDetails:
        """Return what is in a calibration, by default in the one in force."""
        in_force = self._store.current_id()
        if not (request.id or in_force):
            raise RpcError(
                "refused", "no calibration is in force: name the id of one, or install one"
            )
        of: Callable[[str], CalibrationDetails] = context.prepared
        return aged(of(request.id or in_force), in_force)

    def _look(self) -> dict[Path, CalibrationDetails | str]:
        """Return what is in the newest files, as far as they were read."""
        with self._lock:
            there = self._there()
            known = {path: seen for path, (seen, _) in self._found.items()}
            new = [path for path, seen in there.items() if known.get(path) != seen]
            if new:
                read = self._read(new)
                self._found |= {path: (there[path], found) for path, found in read.items()}
            self._found = {path: self._found[path] for path in there if path in self._found}
            return {path: found for path, (_, found) in self._found.items()}

    def _there(self) -> dict[Path, _Known]:
        """Return the newest files of the folder, the newest first."""
        try:
            found = {path: path.stat() for path in self._store.directory.glob("*.json")}
        except OSError as error:
            raise RpcError("failed", f"{error.filename}: {error.strerror}") from None
        newest = sorted(found.items(), key=lambda item: item[1].st_mtime_ns, reverse=True)
        return {path: (s.st_mtime_ns, s.st_size) for path, s in newest[:FILES_MAX]}
