"""Pages of `motord dashboard` without a browser: the socket, as the page uses it."""

import json
import time
from collections import Counter
from contextlib import contextmanager, suppress
from queue import Queue
from threading import Thread

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from motord.dashboard.frames import decode, encode
from tests.support.patience import PATIENCE_S
from tests.system.daemons import Program


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
    """A page that takes what it is sent in a thread, as a browser does, and answers pings.

    hangs: it does both only while a message is waited for.
    """

    def __init__(self, socket, *, hangs=False):
        self.socket = socket
        self.id = 0
        self.latest = {}
        """The newest header of each kind that `next` has returned."""
        self.seen = Counter()
        """How many messages of each kind there were."""
        self._messages = Queue()
        self._answers, self._reader = True, None
        if not hangs:
            self._reader = Thread(target=self._read)
            self._reader.start()

    def hang(self):
        """Answer no pings any more."""
        self._answers = False

    def send(self, **header):
        self.socket.send(encode(header))

    def _read(self):
        try:
            while True:
                self._messages.put(self._received())
        except Exception as end:  # raised where a message is waited for
            self._messages.put(end)

    def _received(self, timeout_s=None):
        header, floats = decode(self.socket.recv(timeout=timeout_s))
        if header["kind"] == "ping" and self._answers:
            with suppress(ConnectionClosed):  # what came before the end is still to be read
                self.send(kind="pong", n=header["n"])
        return header, floats

    def next(self):
        """Return the next message, header and floats. Raises ConnectionClosed."""
        if self._reader is not None:
            message = self._messages.get(timeout=PATIENCE_S)
        else:
            message = self._received(PATIENCE_S)
        if isinstance(message, Exception):
            self._messages.put(message)
            raise message
        header, floats = message
        self.latest[header["kind"]] = header
        self.seen[header["kind"]] += 1
        return header, floats

    def join(self):
        """Wait for the thread, once the socket has ended."""
        if self._reader is not None:
            self._reader.join()

    def until(self, kind, condition=lambda header: True):
        """Return the next message of a kind that fulfils the condition on its header."""
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            header, floats = self.next()
            if header["kind"] == kind and condition(header):
                return header, floats
        raise AssertionError(f"waited in vain for {kind}")

    def state(self, condition):
        """Return the next state that fulfils the condition; those that have come are old."""
        for _ in range(self._messages.qsize()):
            self.next()
        return self.until("state", lambda header: condition(header["data"]))[0]["data"]

    def ask(self, name, **arguments):
        """Return the reply to a request, or the error."""
        self.id += 1
        self.send(kind="rpc", id=self.id, name=name, arguments=arguments)
        header, _ = self.until("reply", lambda header: header["id"] == self.id)
        return header.get("reply", header.get("error"))


@contextmanager
def opened(running, token=None, *, hangs=False):
    """Open a page for as long as the block runs."""
    page = None
    try:
        with running.open(token) as socket:
            page = OpenPage(socket, hangs=hangs)
            yield page
    finally:
        if page is not None:
            page.join()
