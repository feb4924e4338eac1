"""Commands that serve viewers: the page in the browser, Foxglove; pages opened for a person."""

import os
import sys
import threading
from dataclasses import replace
from typing import Annotated

import typer

from motord.cli.bench.overview import All, open_benches
from motord.cli.common_options import AsJson, ReadyAsJson
from motord.cli.connection_options import DEFAULT, Connection, print_answer
from motord.cli.console import fail, group, remark
from motord.process.signal_handlers import INTERRUPTS, handled

NICE = 5
"""Of programs that show a bench: daemon and recorder go first."""


def open_page(url: str) -> bool:
    """Open a page in the browser; return whether one took it.

    Only where somebody sits: a terminal and a display. A browser of the terminal, which would take
    it over, is not asked.
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()) or "CI" in os.environ:
        return False
    if sys.platform != "darwin" and not ({"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()):
        return False
    import webbrowser

    try:
        return webbrowser.open(url)
    except webbrowser.Error:
        return False


FOXGLOVE_EXTRA = "the bridge needs the package foxglove-sdk: pip install 'motord[foxglove]'"

app = group("Serve a bench to other programs.")


@app.callback()
def _group() -> None:
    """Serve a bench to other programs."""


@app.command()
def foxglove(
    connection: Connection = DEFAULT,
    port: Annotated[
        int,
        typer.Option("--port", min=0, max=65535, metavar="P", help="Port to listen on; 0: any."),
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
        fail(FOXGLOVE_EXTRA)

    with connection.connect() as client:
        bench = client.bench
    server = FoxgloveServer(f"motord {bench}", port)
    topics = [topic.name for topic in SERVED]
    ready = {"bench": bench, "url": server.url, "topics": topics}
    text = f"ready: bench {bench} at {server.url} (Foxglove: open connection, Foxglove WebSocket)"

    find, stopping = replace(connection, bench=bench).connect, threading.Event()
    with handled(INTERRUPTS, lambda *_: stopping.set()):
        print_answer(ready, text, as_json)
        os.nice(NICE)
        try:
            run(find, server, lambda line: remark(f"motord: {line}"), stopping)
        finally:
            server.stop()


DASHBOARD_EXTRA = "the page needs more packages: pip install 'motord[dashboard]'"
PORT = 8447


def dashboard(
    port: Annotated[
        int, typer.Option(min=0, max=65535, metavar="P", help="Port of the page; 0: any.")
    ] = PORT,
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Only 127.0.0.1: the page listens on no other.")
    ] = "127.0.0.1",
    browser: Annotated[bool, typer.Option(help="Open the page in a browser.")] = True,
    connection: Connection = DEFAULT,
    all_benches: All = False,
    as_json: AsJson = False,
) -> None:
    """Show a bench that runs in a browser, and operate it there; or all benches, to watch only.

    Prints the address for operators, then the one for viewers, who can watch and command nothing.
    Whoever has an address can use it, from this machine alone. Runs until Ctrl-C; a page that is in
    command gives it back then, and the bench ramps down.
    """
    _check_host(host)
    try:
        from motord.dashboard import server
    except ModuleNotFoundError as error:
        if error.name not in ("starlette", "uvicorn", "websockets"):
            raise
        fail(DASHBOARD_EXTRA)
    if all_benches:
        _serve_overview(port, connection, browser=browser, as_json=as_json)
        return
    with connection.connect() as client:
        tokens = server.tokens_for(client)
        with server.listen(port) as listener:
            urls = server.urls(listener, tokens)
            text = f"{urls.operator}\nto watch only: {urls.viewer}"
            print_answer({"bench": client.bench, "urls": vars(urls)}, text, as_json)
            if not as_json:
                remark(f"bench {client.bench}; Ctrl-C ends the page, not the bench")
            os.nice(NICE)
            if browser:
                open_page(urls.operator)
            again = replace(connection, bench=client.bench)  # not one that came in its place
            server.serve(client, again.connect, listener, tokens)


def _serve_overview(port: int, connection: Connection, *, browser: bool, as_json: bool) -> None:
    from motord.dashboard import server
    from motord.dashboard.tokens import Tokens
    from motord.security.roles import Role

    with open_benches(connection) as benches:
        tokens = Tokens(Role.VIEWER)
        with server.listen(port) as listener:
            address = server.urls(listener, tokens).viewer
            print_answer({"urls": {"viewer": address}}, address, as_json)
            if not as_json:
                remark("all benches, to watch only; Ctrl-C ends the page, not the benches")
            for error in tuple(benches.unreachable.values()):
                remark(f"motord: {error}")
            os.nice(NICE)
            if browser:
                open_page(address)
            server.serve_overview(benches, listener, tokens, connection.identity)


def _check_host(host: str) -> None:
    if host not in ("127.0.0.1", "localhost"):
        fail(
            f"--host {host}: the page listens on 127.0.0.1 alone, as whoever reads its traffic "
            "could command the bench; from another machine use `ssh -L 8447:127.0.0.1:8447 HOST`, "
            "or run `motord dashboard` there with --connect tls/HOST:7448 and --identity"
        )
