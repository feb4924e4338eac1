"""`motord dashboard`: the live page in a browser."""

import os
from ipaddress import ip_address
from typing import Annotated

import typer

from motord.cli.bench.overview import All, open_benches
from motord.cli.common_options import AsJson
from motord.cli.connection_options import DEFAULT, Connection, print_answer
from motord.cli.console import fail, remark
from motord.cli.viewers import NICE, open_page

EXTRA = "the page needs more packages: pip install 'motord[dashboard]'"
PORT = 8447


def dashboard(
    port: Annotated[
        int, typer.Option(min=0, max=65535, metavar="P", help="Port of the page; 0: any.")
    ] = PORT,
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Address of this machine to listen on.")
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
        fail(EXTRA)
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
            server.serve(client, connection.connect, listener, tokens)


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
    try:
        address = ip_address("127.0.0.1" if host == "localhost" else host)
    except ValueError:
        raise typer.BadParameter(f"--host {host} is no address") from None
    if not address.is_loopback:
        fail(
            f"--host {host}: the page listens on this machine alone, as whoever reads its traffic "
            "could command the bench; from another machine use `ssh -L 8447:127.0.0.1:8447 HOST`, "
            "or run `motord dashboard` there with --connect tls/HOST:7448 and --identity"
        )
