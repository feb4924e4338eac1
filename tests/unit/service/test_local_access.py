"""Programs of the daemon's own machine: they may ask and listen, and never speak for the bench."""

import json
import queue
import socket
import threading
import time
from contextlib import ExitStack, suppress

import pytest
import zenoh

from motord.api.endpoints import (
    HANDSHAKE_MS,
    MAX_HANDSHAKES,
    client_config,
    daemon_config,
    router_config,
)
from motord.client import ClientError, connect
from tests.support.patience import PATIENCE_S
from tests.unit.service.live_service import endpoint, live_service

ROOT = "motord/live"
WIDE = ("**", "motord/**", "motord/live/**", "motord/live/rpc/**", "*/*/rpc/lease/*")
EXACT = tuple(f"{ROOT}/rpc/{name}" for name in ("stop", "lease/acquire", "enable", "none/of/ours"))
SPOKEN = ("state", "tick", "ticks", "event", "plan")
FORGED = b'{"forged": true}'


def session(where, mode):
    """Connect in any mode of Zenoh; a peer or router listens on a port of its own, too."""
    if mode == "client":
        return zenoh.open(client_config(where))
    config = router_config([endpoint()])
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("connect/endpoints", json.dumps([where]))
    config.insert_json5("connect/timeout_ms", "-1")
    config.insert_json5("connect/exit_on_failure", "false")
    return zenoh.open(config)


def test_connections_that_say_nothing_keep_nobody_out_for_long(tmp_path):
    with live_service(tmp_path) as service, ExitStack() as silent:
        host, port = service.listen.removeprefix("tcp/").split(":")
        for _ in range(MAX_HANDSHAKES + 8):
            silent.enter_context(socket.create_connection((host, int(port))))
        until_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < until_s:
            with suppress(ClientError):
                connect("live", service.listen).close()
                return
            time.sleep(0.05)
    pytest.fail("they kept everybody out")


def test_the_time_for_a_handshake_is_what_zenoh_applies():
    listening = daemon_config("live", [endpoint()], 1000)
    assert int(listening.get_json("transport/unicast/accept_timeout")) == HANDSHAKE_MS < 10_000


def test_zenoh_asks_no_clock_for_what_is_published():
    """Zenoh's timestamps end in 2106; a session that makes one then panics."""
    where, samples = endpoint(), queue.SimpleQueue()
    with (
        zenoh.open(daemon_config("live", [where], 1000)) as daemon,
        zenoh.open(client_config(where)) as client,
    ):
        client.declare_subscriber(f"{ROOT}/state", samples.put)
        publisher = daemon.declare_publisher(f"{ROOT}/state")
        until_s = time.monotonic() + PATIENCE_S
        while not publisher.matching_status.matching:
            assert time.monotonic() < until_s
            time.sleep(0.01)
        publisher.put(b"{}")
        assert samples.get(timeout=PATIENCE_S).timestamp is None


class Intruder:
    """A session that answers everything, publishes everything and pretends to be the daemon."""

    def __init__(self, stack, where, mode):
        self.captured = []
        self.session = stack.enter_context(session(where, mode))
        for key in (*WIDE, *EXACT):
            self.session.declare_queryable(key, self._answer, complete=True)
        liveliness, alive = self.session.liveliness(), (f"{ROOT}/alive", "motord/evil/alive")
        self._tokens = [liveliness.declare_token(key) for key in alive]  # gone with their objects
        self._publishers = [self.session.declare_publisher(f"{ROOT}/{n}") for n in SPOKEN]

    def _answer(self, query):
        self.captured.append(query.payload.to_bytes() if query.payload else b"")
        with query:
            query.reply(query.key_expr, FORGED)

    def speak(self):
        for publisher in self._publishers:
            publisher.put(FORGED)
        for name in SPOKEN:
            self.session.put(f"{ROOT}/{name}", FORGED)
            self.session.delete(f"{ROOT}/{name}")
        self.session.put(f"{ROOT}/rpc/stop", FORGED)

    def settle(self):
        """Return once the daemon has handled all that this session sent before.

        One that was there first asks until it has found the daemon.
        """
        remote = zenoh.Locality.REMOTE  # not what it declared itself
        until_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < until_s:
            key = f"{ROOT}/rpc/config"
            if list(self.session.get(key, timeout=PATIENCE_S, allowed_destination=remote)):
                return
        pytest.fail("the intruder never reached the daemon")


MODES = ("client", "peer", "router")


@pytest.mark.parametrize("first", [False, True], ids=["comes later", "was there first"])
@pytest.mark.parametrize("mode", MODES)
def test_nothing_is_captured_and_nothing_forged(tmp_path, mode, first):
    where = endpoint()
    with ExitStack() as stack:
        if first and mode != "client":  # a client needs somebody to connect to
            intruder = Intruder(stack, where, mode)
        live = stack.enter_context(live_service(tmp_path, listen=where))
        if not first or mode == "client":
            intruder = Intruder(stack, where, mode)
        client = stack.enter_context(connect(None, live.listen))
        received, ticks = [], threading.Event()
        observer = stack.enter_context(zenoh.open(client_config(live.listen)))
        observer.declare_subscriber(
            "**", lambda s: received.append((str(s.key_expr), bytes(s.payload)))
        )
        observer.declare_subscriber(f"{ROOT}/ticks", lambda sample: ticks.set())
        intruder.settle()
        intruder.speak()
        intruder.settle()
        assert client.bench == "live"
        with client.lease("anna") as lease:
            assert client.rpc("enable", token=lease.token) == {"state": "ENABLED"}
            for target in (zenoh.QueryTarget.ALL, zenoh.QueryTarget.BEST_MATCHING):
                replies = list(
                    observer.get(
                        f"{ROOT}/rpc/stop", target=target, payload=b"{}", timeout=PATIENCE_S
                    )
                )
                assert [json.loads(r.ok.payload.to_bytes())["state"] for r in replies] == ["OFF"]
        assert list(observer.get(f"{ROOT}/rpc/none/of/ours", timeout=PATIENCE_S)) == []
        alive = list(observer.liveliness().get("**", timeout=PATIENCE_S))
        assert [str(token.ok.key_expr) for token in alive] == [f"{ROOT}/alive"]
        assert ticks.wait(PATIENCE_S)
        assert not [key for key, payload in received if payload in (FORGED, b"")]
        assert intruder.captured == []


def test_a_subscriber_of_requests_receives_none(tmp_path):
    with live_service(tmp_path) as live, zenoh.open(client_config(live.listen)) as spy:
        received = []
        spy.declare_subscriber(f"{ROOT}/rpc/**", lambda s: received.append(str(s.key_expr)))
        with connect(None, live.listen) as client, client.lease("anna"):
            client.rpc("stop")
        assert received == []
