"""`--identity`: an option of every command that has `--connect`, added to them in one place."""

import functools
import inspect
from collections.abc import Callable
from contextvars import ContextVar
from pathlib import Path
from typing import Annotated, Any

import typer

shown: ContextVar[Path | None] = ContextVar("shown", default=None)
"""The identity that this command shows when it connects."""

Identity = Annotated[
    Path | None,
    typer.Option(
        "--identity",
        envvar="MOTORD_IDENTITY",
        metavar="DIR",
        help="Certificate to show at a TLS endpoint: a folder made by `motord security add`.",
    ),
]


def with_identity(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return `command` with the option `--identity` if it has `--connect`, else as it is."""
    signature = inspect.signature(command)
    if "connect" not in signature.parameters or "identity" in signature.parameters:
        return command

    @functools.wraps(command)
    def run(*arguments: Any, identity: Path | None = None, **named: Any) -> Any:
        shown.set(identity)
        return command(*arguments, **named)

    option = inspect.Parameter(
        "identity", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Identity
    )
    taken = [*signature.parameters.values(), option]
    run.__signature__ = signature.replace(parameters=taken)  # type: ignore[attr-defined]
    run.__annotations__ = {**command.__annotations__, "identity": Identity}
    return run
