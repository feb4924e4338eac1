"""`motord bridge`: the daemon's data for other programs."""

import json
import os
import signal
import threading
from typing import Annotated

import typer

from motord.cli.connection_options import DEFAULT, Connection
from motord.cli.console import fail, group, print_line, remark
from motord.cli.viewers import NICE

EXTRA = "the bridge needs the package foxglove-sdk: pip install 'motord[foxglove]'"

app = group("Serve a bench to other programs.")


@app.callback()
def _group() -> None:
    """Serve a bench to other programs."""


@app.command()
def foxglove(
    connection: Connection = DEFAULT,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, metavar="P", help="0 takes any free one.")
    ] = 8765,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one line of JSON when ready.")
    ] = False,
) -> None:
    """Serve topics to Foxglove and Lichtblick on 127.0.0.1, read-only, until Ctrl-C or SIGTERM."""
    from motord.client import Client, connect

    try:
        from motord.foxglove.bridge import run
        from motord.foxglove.server import FoxgloveServer
        from motord.foxglove.topics import SERVED
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "foxglove":
            raise
        fail(EXTRA)

    with connection.open() as client:
        bench = client.bench
    server = FoxgloveServer(f"motord {bench}", port)
    topics = [topic.name for topic in SERVED]
    ready = {"bench": bench, "url": server.url, "topics": topics}
    text = f"ready: bench {bench} at {server.url} (Foxglove: open connection, Foxglove WebSocket)"

    def find() -> Client:
        return connect(bench, connection.endpoint, connection.identity)

    stopping = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopping.set())
    print_line(json.dumps(ready) if as_json else text)
    os.nice(NICE)
    try:
        run(find, server, lambda line: remark(f"motord: {line}"), stopping)
    finally:
        server.stop()
