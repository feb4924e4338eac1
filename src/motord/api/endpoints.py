"""Zenoh sessions of daemon and clients: no scouting, only the endpoints of the config."""

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import zenoh

from motord.api.requests import RPCS, max_request_bytes
from motord.security.access import access_control, daemon_access_control
from motord.security.identity import Identity
from motord.security.roles import Role

if TYPE_CHECKING:
    from motord.config import Config

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
"""How long the gateway waits for the daemon before it says that it is open; without a router to
connect to it does not wait."""
BLOCKED_US = 1_000_000
"""A client that takes no replies for so long is disconnected: no thread waits for it."""


Settings = dict[str, Any]
"""Value by path in Zenoh's configuration."""

_BASE: Settings = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "adminspace/enabled": False,
    # Memory shared with another user could be changed, or cut off, while it is being read.
    "transport/shared_memory/enabled": False,
    # Nobody reads them, and none can be made while the clock is set to after 2106: Zenoh panics.
    "timestamping/enabled": False,
}


def _config(*tables: Settings) -> zenoh.Config:
    config = zenoh.Config()
    for settings in (_BASE, *tables):
        for path, value in settings.items():
            config.insert_json5(path, json.dumps(value))
    return config


def _router(listen: Sequence[str], connect: Sequence[str] = ()) -> Settings:
    return {
        "mode": "router",
        "listen/endpoints": list(listen),
        "listen/exit_on_failure": True,
        "connect/endpoints": list(connect),
        "scouting/delay": CONNECT_MS if connect else 0,
    }


def _bounds(clients: int, max_request_bytes: int) -> Settings:
    return {
        "transport/unicast/max_sessions": clients,
        "transport/unicast/accept_pending": MAX_HANDSHAKES,
        "transport/unicast/accept_timeout": HANDSHAKE_MS,
        "transport/link/rx/max_message_size": max_request_bytes + ENVELOPE_BYTES,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": BLOCKED_US,
    }


def router_config(listen: Sequence[str], connect: Sequence[str] = ()) -> zenoh.Config:
    """Return the configuration of a router that listens on `listen` only.

    It connects to `connect`, daemons or routers, and goes on trying while they are not there.
    """
    return _config(_router(listen, connect))


def daemon_config(bench: str, listen: Sequence[str], max_request_bytes: int) -> zenoh.Config:
    """Return the configuration of the daemon's router, where only it speaks for `bench`.

    Messages of more than `max_request_bytes` are dropped by Zenoh as they arrive.
    """
    access = {"access_control": daemon_access_control(bench, RPCS)}
    return _config(_router(listen), access, _bounds(MAX_LOCAL_CLIENTS, max_request_bytes))


def gateway_config(config: "Config", roles: Mapping[str, Role]) -> zenoh.Config:
    """Return the configuration of the gateway: TLS with client certificates, then the daemon."""
    tls = config.zenoh.tls
    assert tls is not None
    files = {
        "root_ca_certificate": str(tls.ca),
        "listen_certificate": str(tls.certificate),
        "listen_private_key": str(tls.key),
        "enable_mtls": True,
        "close_link_on_expiration": True,
    }
    return _config(
        _router(config.zenoh.remote, config.zenoh.local[:1]),
        _bounds(MAX_CLIENTS + 1, max_request_bytes(config.motor.counts)),
        {"transport/link/tls": files, "access_control": access_control(config.bench.name, roles)},
    )


def client_config(endpoint: str, identity: Identity | None = None) -> zenoh.Config:
    """Return the configuration of a client of the daemon at `endpoint`; it tries once."""
    settings: Settings = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 0,
        "connect/exit_on_failure": True,
        "connect/retry": RETRY,
        "transport/link/rx/max_message_size": MAX_REPLY_BYTES,
    }
    if identity is not None:
        settings["transport/link/tls"] = {
            "root_ca_certificate": str(identity.ca),
            "connect_certificate": str(identity.certificate),
            "connect_private_key": str(identity.key),
            "enable_mtls": True,
            "verify_name_on_connect": True,
        }
    return _config(settings)


def key(bench: str, name: str) -> str:
    """Return the key of `name` of a bench."""
    return f"{KEY_ROOT}/{bench}/{name}"
