"""What all commands share that talk to a daemon: options, connection, failure in one line."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.console import fail
from motord.cli.identity import shown

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
        help="Where its daemon listens: tcp/127.0.0.1:7447, unixsock-stream//PATH of a socket, "
        "or tls/HOST:7448 from another machine.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Force = Annotated[
    bool, typer.Option("--force", help="Take command over from whoever has it; it is logged.")
]

ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a daemon listens unless its bench file says otherwise."""


@contextmanager
def daemon(bench: str | None, endpoint: str) -> "Iterator[Client]":
    """Connect to a daemon; whatever it refuses ends the command with one line.

    Who asks is what `--identity` says (`motord.cli.identity`).
    """
    from motord.client import ClientError, connect

    try:
        with connect(bench, endpoint, shown.get()) as client:
            yield client
    except ClientError as error:
        fail(str(error))


def say(answer: Any, words: str, as_json: bool) -> None:
    """Print an answer, as JSON or in words."""
    typer.echo(json.dumps(answer) if as_json else words)
