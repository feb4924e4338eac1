"""The archive: recordings copied, verified and, only if asked for, removed at their source."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from motord.archive import manifest as manifests
from motord.archive.manifest import SUFFIX, ArchiveManifest
from motord.archive.pace import (
    ArchiveError,
    ConflictError,
    Pace,
    PausedError,
    SameFolderError,
)
from motord.archive.selection import FOLDERS, Selection
from motord.archive.verified_copy import copy_verified, naming, partial_of, sha256_of
from motord.atomic_write import sync_folder

DAY_NS = 86_400 * 10**9


@dataclass
class ArchiveReport:
    """What a round has come to; names are paths below the folder of recordings."""

    copied: list[str] = field(default_factory=list)
    there: int = 0
    """Archived before."""
    deleted: list[str] = field(default_factory=list)
    conflicts: dict[str, str] = field(default_factory=dict)
    """Recordings that cannot be archived, and why."""
    being_written: list[str] = field(default_factory=list)
    unfinished: list[str] = field(default_factory=list)
    """Recordings that need recovery."""
    stopped: str = ""
    """Why the round ended early: the archive cannot be written, or the bench is needed."""
    paused: bool = False
    """It was the bench."""


class RecordingArchive:
    """Recordings of the folder `source` in the folder `copies`, which has to exist."""

    def __init__(self, source: Path, copies: Path, pace: Pace) -> None:
        self.source, self.copies, self.pace = source, copies, pace
        self._known: dict[str, tuple[int, int, int]] = {}  # size, mtime and when verified, ns

    def update(
        self,
        selection: Selection,
        delete_after_days: float | None = None,
        on_copied: Callable[[str, ArchiveManifest], None] = lambda name, manifest: None,
    ) -> ArchiveReport:
        """Copy what is not archived yet; delete what has been for long enough, if that is given.

        Raises SameFolderError.
        """
        report = ArchiveReport(
            being_written=selection.being_written, unfinished=selection.unfinished
        )
        try:
            self._require_folders()
            if selection.being_written:
                raise PausedError(f"{selection.being_written[0]} is being written")
            for name in selection.whole:
                with _collected(name, report, self.source / name):
                    if (manifest := self._add(name)) is None:
                        report.there += 1
                    else:
                        report.copied.append(name)
                        on_copied(name, manifest)
                    if delete_after_days is not None and self._delete(name, delete_after_days):
                        report.deleted.append(name)
        except PausedError as error:
            report.stopped, report.paused = str(error), True
        except ArchiveError as error:
            report.stopped = str(error)
        except OSError as error:
            report.stopped = f"{error.filename or self.copies}: {error.strerror or error}"
        return report

    def _require_folders(self) -> None:
        """Raise ArchiveError if there is no archive, SameFolderError if it is no other folder."""
        if not self.copies.is_dir():
            raise ArchiveError(f"{self.copies}: no such folder; is it mounted?")
        inner, outer = self.copies.resolve(), self.source.resolve()
        if inner == outer or outer / FOLDERS[-1] == inner or inner.samefile(outer):
            where = f"{self.copies}: is where the recordings are"
            raise SameFolderError(f"{where}; name another folder")

    def _add(self, name: str) -> ArchiveManifest | None:
        """Archive one recording; return its manifest, None if it was archived before."""
        source, copy = self.source / name, self.copies / name
        status = source.stat()
        if self._known.get(name, ())[:2] == (status.st_size, status.st_mtime_ns):
            return None  # so that --watch does not ask the archive for each one again and again
        self.pace.check()
        there, manifest = manifests.read(copy), None
        if os.path.lexists(copy):
            if not copy.exists():  # a link to nowhere
                raise _another(copy)
            if source.samefile(copy):
                raise ConflictError(f"{copy}: is the recording itself, no copy of it")
            if there is None:
                digest = self._adopted(source, copy)
                manifest = manifests.write(copy, source, status.st_mtime_ns, digest)
            else:
                self._require_same(source, copy, there)
        else:
            with suppress(FileExistsError):  # it is there: another bench may have made it just now
                copy.parent.mkdir()
                sync_folder(copy.parent.parent)
            digest = copy_verified(source, copy, self.pace)
            manifest = manifests.write(copy, source, status.st_mtime_ns, digest)
        verified = manifest or there
        assert verified is not None
        self._known[name] = (status.st_size, status.st_mtime_ns, verified.verified_ns)
        return manifest

    def _adopted(self, source: Path, copy: Path) -> str:
        """Return the SHA-256 of a whole copy whose maker was killed before it wrote the manifest.

        Raises ConflictError if it is not a copy of this recording.
        """
        digest = ""
        if source.stat().st_size == copy.stat().st_size:
            with copy.open("rb") as file, naming(copy):
                os.fsync(file.fileno())
            digest = sha256_of(copy, self.pace)
        if not digest or sha256_of(source, self.pace) != digest:
            raise _another(copy)
        partial_of(source, copy).unlink(missing_ok=True)
        sync_folder(copy.parent)
        return digest

    def _require_same(self, source: Path, copy: Path, manifest: ArchiveManifest) -> None:
        """Raise ConflictError unless the copy is that of the recording, as far as seen at once."""
        if copy.stat().st_size != manifest.bytes:
            raise ConflictError(
                f"{copy}: is not as its manifest says; if you remove both, it is copied again"
            )
        status = source.stat()
        known = (status.st_size, status.st_mtime_ns) == (manifest.bytes, manifest.source_mtime_ns)
        if not known and sha256_of(source, self.pace) != manifest.sha256:
            raise _another(copy)

    def _delete(self, name: str, after_days: float) -> bool:
        """Remove a recording whose copy was verified so long ago, if it still is the same."""
        if time.time_ns() - self._known[name][2] < after_days * DAY_NS:
            return False
        source, copy = self.source / name, self.copies / name
        if not copy.exists():
            del self._known[name]
            raise ConflictError(f"{copy}: is gone; the recording is not deleted, but copied again")
        if (manifest := manifests.read(copy)) is None:
            raise ConflictError(f"{copy}: has no manifest; the recording is not deleted")
        before = source.stat()
        if source.samefile(copy):
            raise ConflictError(f"{copy}: is the recording itself, no copy of it")
        if not sha256_of(copy, self.pace) == manifest.sha256 == sha256_of(source, self.pace):
            raise ConflictError(f"{copy}: is not the same as the recording, which is not deleted")
        now = source.stat()
        if (now.st_ino, now.st_mtime_ns) != (before.st_ino, before.st_mtime_ns):
            raise ConflictError(f"{source}: changed meanwhile; it is not deleted")
        source.unlink()
        sync_folder(source.parent)
        del self._known[name]
        return True


def verify(copies: Path, pace: Pace) -> Iterator[tuple[str, str]]:
    """Re-read every copy; yield its path in the archive and what is wrong with it, "" if nothing.

    Raises ArchiveError if the archive is not there.
    """
    if not copies.is_dir():
        raise ArchiveError(f"{copies}: no such folder; is it mounted?")
    names = {path.with_suffix("") for path in copies.rglob(f"*.mcap{SUFFIX}")}
    for copy in sorted(names | set(copies.rglob("*.mcap"))):
        if not copy.name.startswith("."):
            yield str(copy.relative_to(copies)), _problem(copy, pace)


def _problem(copy: Path, pace: Pace) -> str:
    try:
        manifest = manifests.read(copy)
        if manifest is None:
            return "has no manifest"
        if not copy.exists():
            return "is missing"
        if copy.stat().st_size != manifest.bytes:
            return f"has {copy.stat().st_size} bytes in place of {manifest.bytes}"
        differs = sha256_of(copy, pace) != manifest.sha256
        return f"differs from what was archived on {manifest.verified}" if differs else ""
    except (ConflictError, OSError) as error:
        return f"cannot be read: {error}"


@contextmanager
def _collected(name: str, report: ArchiveReport, source: Path) -> Iterator[None]:
    """Collect what is wrong with one recording; the next ones are archived all the same."""
    try:
        yield
    except ConflictError as error:
        report.conflicts[name] = str(error)
    except OSError as error:
        if error.filename != str(source):
            raise
        if os.path.lexists(source):  # else the daemon has removed an old black box
            report.conflicts[name] = f"{source}: {error.strerror}"


def _another(copy: Path) -> ConflictError:
    return ConflictError(
        f"{copy}: is another file than the recording of this name; it is left alone. Rename it, or "
        "archive to another folder"
    )
