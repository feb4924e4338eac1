"""Subscribers in processes of their own that account for every tick: received, missed, lost."""

import json
import subprocess
import sys
from dataclasses import dataclass

SUBSCRIBER = """
import json, sys, threading
import zenoh
from motord.api.endpoints import client_config
from motord.client import Client

bench, endpoint, room_bytes = sys.argv[1:]
config = client_config(endpoint)
if int(room_bytes):
    config.insert_json5("transport/link/tcp/so_rcvbuf", room_bytes)
with Client(zenoh.open(config), bench, endpoint) as client:
    print("up", flush=True)
    while sys.stdin.readline():
        received, ends, first = [0], [], threading.Event()

        def count(block):
            received[0] += len(block)
            ends[1:] = [int(block["tick"][-1])]
            if len(ends) == 1:
                ends.insert(0, int(block["tick"][0]))
            first.set()

        ticks = client.subscribe_ticks(count)
        first.wait()
        print("on", flush=True)
        sys.stdin.readline()
        ticks.close()
        print(json.dumps([received[0], *ticks.losses, ends]), flush=True)
"""
"""Subscribes at one line on stdin, says so when ticks come: a publisher that knows of it only later
never sends to one that is stopped. Ends it at the next line; says what came and what did not."""


@dataclass(frozen=True)
class Account:
    """What one subscriber received, what it lost, and the span from its first to its last tick."""

    received: int
    lost: int
    missed: int
    restarts: int
    span: int

    @property
    def silent(self) -> int:
        """Ticks that are in no account."""
        return self.span - self.received - self.lost - self.missed


class Subscriber:
    """A process that subscribes on command. room_bytes: for what it has not read."""

    def __init__(self, bench: str, endpoint: str, room_bytes: int = 0) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", SUBSCRIBER, bench, endpoint, str(room_bytes)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._says() == "up\n"

    def __enter__(self) -> "Subscriber":
        return self

    def __exit__(self, *error: object) -> None:
        self.process.kill()
        self.process.communicate()

    def begin(self) -> None:
        """Subscribe; return when ticks come."""
        self._send_line()
        assert self._says() == "on\n"

    def end(self) -> Account:
        """End the subscription and return its account."""
        self._send_line()
        received, lost, missed, restarts, ends = json.loads(self._says())
        span = ends[-1] - ends[0] + 1 if ends else 0
        return Account(received, lost, missed, restarts, span)

    def _send_line(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write("\n")
        self.process.stdin.flush()

    def _says(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline()
