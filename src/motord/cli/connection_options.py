"""What all commands share that talk to a daemon: options, connection, failure in one line.

A command has one argument `connection`; `with_connection` makes the options of it.
"""

import functools
import inspect
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord import DEFAULT_ENDPOINT
from motord.cli.console import print_line
from motord.process.collector_pause import collector_paused

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

Identity = Annotated[
    Path | None,
    typer.Option(
        "--identity",
        envvar="MOTORD_IDENTITY",
        metavar="DIR",
        help="Certificate to show at a TLS endpoint: a folder made by `motord security add`.",
    ),
]


@dataclass(frozen=True)
class Connection:
    """Which bench, where its daemon listens, and the identity to show there."""

    bench: str | None = None
    endpoint: str = DEFAULT_ENDPOINT
    identity: Path | None = None

    @property
    def endpoints(self) -> list[str]:
        """The endpoints of a command that takes several, by commas."""
        found = [one.strip() for one in self.endpoint.split(",")]
        return [one for one in found if one] or [self.endpoint]

    def connect(self) -> "Client":
        """Connect to the daemon. Raises ClientError."""
        with collector_paused():
            from motord.client import connect

        return connect(self.bench, self.endpoint, self.identity)


DEFAULT = Connection()

_OPTIONS = [
    inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
    for name, annotation, default in (
        ("bench", Bench, None), ("connect", Connect, DEFAULT_ENDPOINT), ("identity", Identity, None)
    )
]  # fmt: skip


def with_connection(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return `command` with the options that make up its argument `connection`, if it has one."""
    signature = inspect.signature(command)
    if "connection" not in signature.parameters:
        return command

    @functools.wraps(command)
    def run(bench: str | None, connect: str, identity: Path | None, **named: Any) -> Any:
        return command(**named, connection=Connection(bench, connect, identity))

    parameters: list[inspect.Parameter] = []
    for own in signature.parameters.values():
        keyword = own.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        parameters += _OPTIONS if own.name == "connection" else [keyword]
    run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {one.name: one.annotation for one in parameters}
    return run


def print_answer(answer: Any, text: str, as_json: bool) -> None:
    """Print an answer, as JSON or as text."""
    print_line(json.dumps(answer) if as_json else text)
