"""Zenoh sessions of daemon and clients: no scouting, only the endpoints of the config."""

import json
from collections.abc import Mapping, Sequence

import zenoh

from motord.api.requests import RPCS, max_request_bytes
from motord.config import Config
from motord.security.access import access_control, daemon_access_control
from motord.security.identity import Identity
from motord.security.roles import Role

UNIX_SOCKET = "unixsock-stream/"
"""Prefix of the endpoint of a Unix socket, before its path."""
KEY_ROOT = "motord"
RETRY = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2}
"""Reconnection of a client."""
MAX_CLIENTS = 32
"""Connections from other machines at a time."""
MAX_LOCAL_CLIENTS = 64
"""Connections from this machine at a time, that of the gateway among them."""
MAX_HANDSHAKES = 32
"""Connections at a time that are not yet authenticated."""
HANDSHAKE_MS = 2000
"""For each of them: connections that send nothing keep others out no longer than that."""
ENVELOPE_BYTES = 4096
"""Added to the payload of a request by Zenoh: key and headers."""
MAX_REPLY_BYTES = 64 * 1024 * 1024
"""To a client. The largest is `config` with a table of the back-EMF at 1,048,576 counts."""
CONNECT_MS = 500
"""How long the gateway waits for the daemon before it says that it is open."""
BLOCKED_US = 1_000_000
"""A client that takes no replies for so long is disconnected: no thread waits for it."""


def _base() -> zenoh.Config:
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    config.insert_json5("adminspace/enabled", "false")
    # Memory shared with another user could be changed, or cut off, while it is being read.
    config.insert_json5("transport/shared_memory/enabled", "false")
    return config


def router_config(listen: Sequence[str]) -> zenoh.Config:
    """Return the configuration of a router that listens on `listen` only."""
    config = _base()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps(list(listen)))
    config.insert_json5("listen/exit_on_failure", "true")
    config.insert_json5("connect/endpoints", "[]")
    config.insert_json5("scouting/delay", "0")  # it looks for nobody, so it waits for nobody
    return config


def daemon_config(bench: str, listen: Sequence[str], max_request_bytes: int) -> zenoh.Config:
    """Return the configuration of the daemon's router, where only it speaks for `bench`.

    Messages of more than `max_request_bytes` are dropped by Zenoh as they arrive.
    """
    config = router_config(listen)
    config.insert_json5("access_control", json.dumps(daemon_access_control(bench, RPCS)))
    _bound(config, MAX_LOCAL_CLIENTS, max_request_bytes)
    return config


def _bound(config: zenoh.Config, clients: int, max_request_bytes: int) -> None:
    link = "transport/link"
    config.insert_json5("transport/unicast/max_sessions", str(clients))
    config.insert_json5("transport/unicast/accept_pending", str(MAX_HANDSHAKES))
    config.insert_json5("transport/unicast/accept_timeout", str(HANDSHAKE_MS))
    config.insert_json5(f"{link}/rx/max_message_size", str(max_request_bytes + ENVELOPE_BYTES))
    blocked = f"{link}/tx/queue/congestion_control/block/wait_before_close"
    config.insert_json5(blocked, str(BLOCKED_US))


def gateway_config(config: Config, roles: Mapping[str, Role]) -> zenoh.Config:
    """Return the configuration of the gateway: TLS with client certificates, then the daemon."""
    tls = config.zenoh.tls
    assert tls is not None
    gateway = router_config(config.zenoh.remote)
    gateway.insert_json5("scouting/delay", str(CONNECT_MS))  # until it has found the daemon
    gateway.insert_json5("connect/endpoints", json.dumps(config.zenoh.local[:1]))
    _bound(gateway, MAX_CLIENTS + 1, max_request_bytes(config.motor.counts))
    files = {
        "root_ca_certificate": str(tls.ca),
        "listen_certificate": str(tls.certificate),
        "listen_private_key": str(tls.key),
        "enable_mtls": True,
        "close_link_on_expiration": True,
    }
    gateway.insert_json5("transport/link/tls", json.dumps(files))
    gateway.insert_json5("access_control", json.dumps(access_control(config.bench.name, roles)))
    return gateway


def client_config(endpoint: str, identity: Identity | None = None) -> zenoh.Config:
    """Return the configuration of a client of the daemon at `endpoint`; it tries once."""
    config = _base()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("connect/timeout_ms", "0")
    config.insert_json5("connect/exit_on_failure", "true")
    config.insert_json5("connect/retry", json.dumps(RETRY))
    config.insert_json5("transport/link/rx/max_message_size", str(MAX_REPLY_BYTES))
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
