"""Zenoh sessions of the daemon and of its clients: no scouting, only what the config names."""

import json
from collections.abc import Mapping, Sequence

import zenoh

from motord.api.requests import REQUESTS, max_request_bytes
from motord.config import Config
from motord.security.access import access_control, daemon_access_control
from motord.security.identity import Identity
from motord.security.roles import Role

UNIX_SOCKET = "unixsock-stream/"
"""What the endpoint of a Unix socket begins with; its path follows."""
KEY_ROOT = "motord"
AGAIN = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2}
"""When a client whose connection has ended tries again."""
MAX_CLIENTS = 32
"""So many connections from other machines at a time."""
MAX_LOCAL_CLIENTS = 64
"""So many connections of this machine at a time, the gate's among them."""
MAX_ARRIVING = 32
"""So many at a time that have connected but not yet said who they are."""
ARRIVING_MS = 2000
"""For so long at most each: connections that say nothing keep others out no longer than that."""
ENVELOPE_BYTES = 4096
"""What Zenoh adds to the payload of a request: its key and headers."""
MAX_ANSWER_BYTES = 64 * 1024 * 1024
"""To a client. The largest is `config` with a table of the back-EMF at 1,048,576 counts."""
STUCK_US = 1_000_000
"""Who takes no answers for so long is disconnected: the thread that answers waits for nobody."""


def _quiet() -> zenoh.Config:
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    config.insert_json5("adminspace/enabled", "false")
    # Memory shared with another user could be changed, or cut off, while it is being read.
    config.insert_json5("transport/shared_memory/enabled", "false")
    return config


def router_config(listen: Sequence[str]) -> zenoh.Config:
    """Return the configuration of a router that listens on `listen` only."""
    config = _quiet()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps(list(listen)))
    config.insert_json5("listen/exit_on_failure", "true")
    config.insert_json5("connect/endpoints", "[]")
    return config


def daemon_config(bench: str, listen: Sequence[str], max_request_bytes: int) -> zenoh.Config:
    """Return the configuration of the daemon's router, on which nobody but it speaks for `bench`.

    Messages of more than `max_request_bytes` are dropped by Zenoh as they arrive.
    """
    config = router_config(listen)
    config.insert_json5("access_control", json.dumps(daemon_access_control(bench, REQUESTS)))
    _bound(config, MAX_LOCAL_CLIENTS, max_request_bytes)
    return config


def _bound(config: zenoh.Config, clients: int, max_request_bytes: int) -> None:
    link = "transport/link"
    config.insert_json5("transport/unicast/max_sessions", str(clients))
    config.insert_json5("transport/unicast/accept_pending", str(MAX_ARRIVING))
    config.insert_json5("transport/unicast/accept_timeout", str(ARRIVING_MS))
    config.insert_json5(f"{link}/rx/max_message_size", str(max_request_bytes + ENVELOPE_BYTES))
    stuck = f"{link}/tx/queue/congestion_control/block/wait_before_close"
    config.insert_json5(stuck, str(STUCK_US))


def gate_config(config: Config, roles: Mapping[str, Role]) -> zenoh.Config:
    """Return the configuration of the gate: TLS with certificates in, the daemon behind it."""
    tls = config.zenoh.tls
    assert tls is not None
    gate = router_config(config.zenoh.remote)
    gate.insert_json5("connect/endpoints", json.dumps(config.zenoh.local[:1]))
    _bound(gate, MAX_CLIENTS + 1, max_request_bytes(config.motor.counts))
    files = {
        "root_ca_certificate": str(tls.ca),
        "listen_certificate": str(tls.certificate),
        "listen_private_key": str(tls.key),
        "enable_mtls": True,
        "close_link_on_expiration": True,
    }
    gate.insert_json5("transport/link/tls", json.dumps(files))
    gate.insert_json5("access_control", json.dumps(access_control(config.bench.name, roles)))
    return gate


def client_config(endpoint: str, identity: Identity | None = None) -> zenoh.Config:
    """Return the configuration of a client of the daemon at `endpoint`; it tries once."""
    config = _quiet()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("connect/timeout_ms", "0")
    config.insert_json5("connect/exit_on_failure", "true")
    config.insert_json5("connect/retry", json.dumps(AGAIN))
    config.insert_json5("transport/link/rx/max_message_size", str(MAX_ANSWER_BYTES))
    if identity is not None:
        files = {
            "root_ca_certificate": str(identity.ca),
            "connect_certificate": str(identity.certificate),
            "connect_private_key": str(identity.key),
            "enable_mtls": True,
            "verify_name_on_connect": True,
        }
        config.insert_json5("transport/link/tls", json.dumps(files))
    return config


def key(bench: str, name: str) -> str:
    """Return the key of `name` of a bench."""
    return f"{KEY_ROOT}/{bench}/{name}"
