"""Results that exist as JSON, as `motord analyse -o` writes them, made ready for a store."""

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from motord.config.experiments import AnalysisKind
from motord.recording.mcap.records import MAGIC
from motord.results.error import ResultsError
from motord.results.figures import figures
from motord.results.stored_result import StoredResult, file_digest
from motord.untrusted import parse_json, read_text


def read_result(path: Path, kinds: Mapping[str, AnalysisKind]) -> StoredResult:
    """Return the result in a file; kinds: by the schema of their JSON.

    Version and recordings are not known of it; its time is that of `created`, else of the file.
    Raises ResultsError.
    """
    try:
        content = parse_json(read_text(path))
        json.dumps(content, ensure_ascii=False).encode()  # no halves of characters
        digest, changed_s = file_digest(path), path.stat().st_mtime
    except (OSError, ValueError) as error:
        raise ResultsError(f"{path}: {_what_is_wrong(path, error)}") from error
    schema = content.get("schema") if isinstance(content, dict) else None
    if not isinstance(schema, str) or schema not in kinds:
        reason = f"its schema is {schema!r}" if schema else "it names no schema"
        raise ResultsError(f"{path}: no result of an analysis: {reason}")
    found = figures(content, kinds[schema].leading)
    if not found:
        raise ResultsError(f"{path}: no result of an analysis: it has no figures")
    motor = content.get("motor")
    alone = {"name": motor, "serial": content.get("serial")}
    known: Mapping[str, Any] = motor if isinstance(motor, dict) else alone
    runs = content.get("runs")
    return StoredResult(
        experiment=kinds[schema].name,
        motor=_text(known.get("name")),
        serial=_text(known.get("serial")),
        bench=_text(content.get("bench")),
        run=", ".join(sorted(map(str, runs))) if isinstance(runs, list) else "",
        time=_time(content.get("created")) or datetime.fromtimestamp(int(changed_s), UTC),
        version="",
        settings={"added": f"sha256:{digest}"},
        recordings=(),
        figures=found,
    )


def _what_is_wrong(path: Path, error: OSError | ValueError) -> str:
    """Return why a file is no result, and of a recording which command makes one of it."""
    if _is_recording(path):
        made = f"motord analyse KIND {path} --store DIR makes the result and adds it"
        return f"a recording, no result: {made}"
    if isinstance(error, OSError):
        return f"cannot read it: {error.strerror}"
    text = isinstance(error, UnicodeDecodeError)
    return f"no result of an analysis: {'no text' if text else 'no valid JSON'}: {error}"


def _is_recording(path: Path) -> bool:
    """Return whether a file begins as recordings do; one that cannot be read is none."""
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except (OSError, ValueError):
        return False


def _text(value: object) -> str:
    return value if isinstance(value, str) else ""


def _time(value: object) -> datetime | None:
    try:
        found = datetime.fromisoformat(_text(value))
        return found.astimezone(UTC) if found.tzinfo else found.replace(tzinfo=UTC)
    except (OverflowError, ValueError):  # at the ends of the calendar another zone has no year
        return None
