"""`motord bridge`: the daemon's data for other programs."""

import os
import signal
import threading
from dataclasses import replace
from typing import Annotated

import typer

from motord.cli.common_options import ReadyAsJson
from motord.cli.connection_options import DEFAULT, Connection, print_answer
from motord.cli.console import fail, group, remark
from motord.cli.viewers import NICE
from motord.process.signal_handlers import handled

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
    as_json: ReadyAsJson = False,
) -> None:
    """Serve topics to Foxglove and Lichtblick on 127.0.0.1, read-only, until Ctrl-C or SIGTERM."""
    try:
        from motord.foxglove.bridge import run
        from motord.foxglove.server import FoxgloveServer
        from motord.foxglove.topics import SERVED
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "foxglove":
            raise
        fail(EXTRA)

    with connection.connect() as client:
        bench = client.bench
    server = FoxgloveServer(f"motord {bench}", port)
    topics = [topic.name for topic in SERVED]
    ready = {"bench": bench, "url": server.url, "topics": topics}
    text = f"ready: bench {bench} at {server.url} (Foxglove: open connection, Foxglove WebSocket)"

    find, stopping = replace(connection, bench=bench).connect, threading.Event()
    with handled((signal.SIGINT, signal.SIGTERM), lambda *_: stopping.set()):
        print_answer(ready, text, as_json)
        os.nice(NICE)
        try:
            run(find, server, lambda line: remark(f"motord: {line}"), stopping)
        finally:
            server.stop()
