"""Pages of `motord dashboard` without a browser: the socket, as the page uses it."""

import json
import time
from collections import Counter
from contextlib import contextmanager, suppress

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from motord.dashboard.frames import decode, encode
from tests.system.daemons import PATIENCE_S, Program


class Dashboard(Program):
    """A running `motord dashboard`."""

    def __init__(self, folder, endpoint, *more):
        arguments = ("--port", "0", "--no-browser", "--json", "--connect", endpoint, *more)
        super().__init__(folder, "dashboard", *arguments)
        urls = json.loads(self.first_line)["urls"]
        self.base = urls["operator"].partition("/#")[0]
        self.operator, self.viewer = (
            urls[role].partition("#token=")[2] for role in ("operator", "viewer")
        )

    @property
    def port(self):
        return int(self.base.rpartition(":")[2])

    @property
    def address(self):
        return self.base.replace("http:", "ws:") + "/socket"

    def open(self, token=None, origin=None, **options):
        """Open the socket of a page."""
        return connect(
            self.address,
            subprotocols=["motord.1", self.operator if token is None else token],
            origin=origin or self.base,
            max_size=None,
            compression=None,
            close_timeout=1,
            ping_interval=None,
            **options,
        )


@contextmanager
def dashboard(folder, endpoint, *more):
    """Run the server of the page for as long as the block runs."""
    running = Dashboard(folder, endpoint, *more)
    try:
        yield running
    finally:
        running.close()


class OpenPage:
    """A page that answers pings while it receives."""

    def __init__(self, socket):
        self.socket = socket
        self.id = 0
        self.latest = {}
        """The newest header of each kind."""
        self.seen = Counter()
        """How many messages of each kind there were."""

    def send(self, **header):
        self.socket.send(encode(header))

    def next(self):
        """Return the next message, header and floats."""
        header, floats = decode(self.socket.recv(timeout=PATIENCE_S))
        if header["kind"] == "ping":
            with suppress(ConnectionClosed):  # what came before the end is still to be read
                self.send(kind="pong", n=header["n"])
        self.latest[header["kind"]] = header
        self.seen[header["kind"]] += 1
        return header, floats

    def until(self, kind, condition=lambda header: True):
        """Return the next message of a kind that fulfils the condition on its header."""
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            header, floats = self.next()
            if header["kind"] == kind and condition(header):
                return header, floats
        raise AssertionError(f"waited in vain for {kind}")

    def state(self, condition):
        """Return the next state that fulfils the condition."""
        return self.until("state", lambda header: condition(header["data"]))[0]["data"]

    def ask(self, name, **arguments):
        """Return the reply to a request, or the error."""
        self.id += 1
        self.send(kind="rpc", id=self.id, name=name, arguments=arguments)
        header, _ = self.until("reply", lambda header: header["id"] == self.id)
        return header.get("reply", header.get("error"))


@contextmanager
def opened(running, token=None):
    """Open a page for as long as the block runs."""
    with running.open(token) as socket:
        yield OpenPage(socket)
