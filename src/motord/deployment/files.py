"""Files that belong together: compared with what is there, written whole, removed again.

A manifest remembers what was written, so that exactly this is removed, and that nothing is written
over which somebody else wrote or edited.
"""

import difflib
import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from motord.atomic_write import write_whole
from motord.untrusted import parse_json

Difference = Literal["new", "same", "changed", "edited"]
"""Of a file that is to be there: `edited` is one that differs from what was last written."""


class DeploymentError(Exception):
    """A service that cannot be installed or removed; the message says what to do."""


@dataclass(frozen=True)
class DeployedFile:
    """A file of a service. path: on the target, absolute; kept: it stays on removal."""

    path: Path
    text: str
    kept: bool = False


class Deployment:
    """Files below `root`, and the manifest of what was written: request and files with hashes."""

    def __init__(self, manifest: Path, root: Path = Path("/")) -> None:
        self._root = root
        self._manifest = self.place(manifest)

    def place(self, path: Path) -> Path:
        """Return where a path of the target is."""
        return self._root / path.relative_to("/")

    @property
    def request(self) -> dict[str, Any] | None:
        """What was asked for when it was written; None if nothing is there."""
        content = self._content()
        return None if content is None else content["request"]

    @property
    def remembered(self) -> dict[Path, str]:
        """The files that were written and go on removal, and their hashes."""
        content = self._content() or {"files": {}}
        return {Path(path): str(written) for path, written in content["files"].items()}

    def difference(self, file: DeployedFile) -> Difference:
        """Compare one file with what is there."""
        there = self._text(file.path)
        if there is None:
            return "new"
        if there == file.text:
            return "same"
        return "changed" if self.remembered.get(file.path) == _hash(there) else "edited"

    def diff(self, file: DeployedFile) -> str:
        """Return the unified diff from what is there to the file, "" if they are the same."""
        there = self._text(file.path)
        old, new = (there or "").splitlines(), file.text.splitlines()
        before = "/dev/null" if there is None else str(file.path)
        return "\n".join(difflib.unified_diff(old, new, before, str(file.path), lineterm=""))

    def write(
        self, files: Sequence[DeployedFile], request: dict[str, Any], *, force: bool
    ) -> list[Path]:
        """Write what is not there yet; return it. Raises DeploymentError before that."""
        found = [(file, self.difference(file)) for file in files]
        edited = [str(file.path) for file, difference in found if difference == "edited"]
        if edited and not force:
            raise DeploymentError(
                f"{', '.join(edited)}: there already, and not as installed. See the difference "
                "with --dry-run; --force replaces it and keeps the old one as .old"
            )
        with _readable_by_all():
            for file, difference in found:
                place = self.place(file.path)
                place.parent.mkdir(parents=True, exist_ok=True)
                if difference == "edited":
                    old = place.with_name(f"{place.name}.old")
                    write_whole(old, place.read_bytes(), access_of=place)
                if difference != "same":
                    write_whole(place, file.text)
            self._remember(files, request)
        return [file.path for file, difference in found if difference != "same"]

    def removable(self) -> tuple[list[Path], list[Path]]:
        """Return what was written and is there as it was, and what was edited since."""
        removable: list[Path] = []
        edited: list[Path] = []
        for path, written in self.remembered.items():
            there = self._text(path)
            if there is not None:
                (removable if _hash(there) == written else edited).append(path)
        return removable, edited

    def remove(self) -> tuple[list[Path], list[Path]]:
        """Remove what is `removable`; return the same."""
        removable, edited = self.removable()
        for path in removable:
            self.place(path).unlink()
        self._manifest.unlink(missing_ok=True)
        return removable, edited

    def _remember(self, files: Sequence[DeployedFile], request: dict[str, Any]) -> None:
        written = {str(path): digest for path, digest in self.remembered.items()}
        written |= {str(file.path): _hash(file.text) for file in files if not file.kept}
        self._manifest.parent.mkdir(parents=True, exist_ok=True)
        write_whole(
            self._manifest, json.dumps({"request": request, "files": written}, indent=2) + "\n"
        )

    def _content(self) -> dict[str, Any] | None:
        try:
            content = parse_json(self._manifest.read_text())
            if isinstance(content["request"], dict) and isinstance(content["files"], dict):
                return dict(content)
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError):
            pass
        raise DeploymentError(f"{self._manifest}: not a list of installed files; remove it")

    def _text(self, path: Path) -> str | None:
        try:
            return self.place(path).read_text(encoding="utf-8", errors="surrogateescape")
        except FileNotFoundError:
            return None


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode(errors="surrogateescape")).hexdigest()


@contextmanager
def _readable_by_all() -> Iterator[None]:
    """New files of 0644 in folders of 0755, whatever the caller's mask; others stay as they are."""
    before = os.umask(0o022)
    try:
        yield
    finally:
        os.umask(before)
