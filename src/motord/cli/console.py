"""How every command speaks: one clear line on failure, JSON on request."""

import json
import sys
from typing import Any, NoReturn

import typer


def fail(message: str) -> NoReturn:
    """Print one line on stderr and end with exit code 1."""
    print(f"motord: {' '.join(message.split())}", file=sys.stderr)  # noqa: T201
    raise typer.Exit(1)


def print_json(obj: Any) -> None:
    """Print `obj` as one JSON document on stdout."""
    print(json.dumps(obj, indent=2, allow_nan=True))  # noqa: T201
