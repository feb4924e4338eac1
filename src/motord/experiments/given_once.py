"""Recordings that count once: one given twice would make a result seem more certain than it is."""

import hashlib
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from motord.experiments.subject import AnalysisError


def check_given_once(paths: Sequence[Path]) -> None:
    """Raise AnalysisError if two files have the same content. Raises OSError."""
    sizes = {path: path.stat().st_size for path in paths}
    for _, alike in groupby(sorted(paths, key=sizes.__getitem__), sizes.__getitem__):
        found = list(alike)  # in the order given
        if len(found) > 1:
            _check_contents(found)


def _check_contents(paths: Sequence[Path]) -> None:
    seen: dict[str, Path] = {}
    for path in paths:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        if digest in seen:
            raise AnalysisError(
                f"{path}: is the same recording as {seen[digest]}; counted twice it would seem "
                "more certain than it is: name it once"
            )
        seen[digest] = path
