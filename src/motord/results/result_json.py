"""Results that exist as JSON, as `motord analyse -o` writes them, made ready for a store."""

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from motord.config.experiments import AnalysisKind
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
    except OSError as error:
        raise ResultsError(f"{path}: cannot read it: {error.strerror}") from error
    except ValueError as error:
        raise ResultsError(f"{path}: no result of an analysis: no valid JSON: {error}") from None
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


def _text(value: object) -> str:
    return value if isinstance(value, str) else ""


def _time(value: object) -> datetime | None:
    try:
        found = datetime.fromisoformat(_text(value))
    except ValueError:
        return None
    return found if found.tzinfo else found.replace(tzinfo=UTC)
