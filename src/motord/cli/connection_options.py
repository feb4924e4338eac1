"""What all commands share that talk to a daemon: options, connection, failure in one line.

`--identity` is an option of every command that has `--connect`; `with_identity` adds it.
"""

import functools
import inspect
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord import DEFAULT_ENDPOINT

if TYPE_CHECKING:
    from motord.client import Client

Bench = Annotated[
    str | None,
    typer.Option("--bench", metavar="NAME", help="Which bench; not needed if there is only one."),
]
Connect = Annotated[
    str,
    typer.Option(
        "--connect",
        envvar="MOTORD_CONNECT",
        metavar="ENDPOINT",
        help=f"Where its daemon listens: {DEFAULT_ENDPOINT}, unixsock-stream//PATH of a socket, "
        "or tls/HOST:7448 from another machine.",
    ),
]
Force = Annotated[
    bool, typer.Option("--force", help="Take command over from whoever has it; it is logged.")
]

ENDPOINT = DEFAULT_ENDPOINT

given_identity: ContextVar[Path | None] = ContextVar("given_identity", default=None)
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
        given_identity.set(identity)
        return command(*arguments, **named)

    option = inspect.Parameter(
        "identity", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Identity
    )
    taken = [*signature.parameters.values(), option]
    run.__signature__ = signature.replace(parameters=taken)  # type: ignore[attr-defined]
    run.__annotations__ = {**command.__annotations__, "identity": Identity}
    return run


@contextmanager
def daemon(bench: str | None, endpoint: str) -> "Iterator[Client]":
    """Connect to a daemon with the identity of this command. Raises ClientError."""
    from motord.client import connect

    with connect(bench, endpoint, given_identity.get()) as client:
        yield client


def print_answer(answer: Any, text: str, as_json: bool) -> None:
    """Print an answer, as JSON or as text."""
    typer.echo(json.dumps(answer) if as_json else text)
