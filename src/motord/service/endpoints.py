"""Zenoh sessions of the daemon and of its clients: no scouting, only what the config names."""

import json
from collections.abc import Mapping, Sequence

import zenoh

from motord.config import Config
from motord.security.access import access_control
from motord.security.identity import Identity
from motord.security.roles import Role

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
KEY_ROOT = "motord"
AGAIN = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2}
"""When a client whose connection has ended tries again."""
MAX_CLIENTS = 32
"""So many connections from other machines at a time."""
MAX_MESSAGE_BYTES = 80 * 1024 * 1024
"""From other machines: the largest request, a calibration, with some room."""


def _quiet() -> zenoh.Config:
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    config.insert_json5("adminspace/enabled", "false")
    return config


def router_config(listen: Sequence[str]) -> zenoh.Config:
    """Return the configuration of the daemon's router, which listens on `listen` only."""
    config = _quiet()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps(list(listen)))
    config.insert_json5("listen/exit_on_failure", "true")
    config.insert_json5("connect/endpoints", "[]")
    return config


def gate_config(config: Config, roles: Mapping[str, Role]) -> zenoh.Config:
    """Return the configuration of the gate: TLS with certificates in, the daemon behind it."""
    tls = config.zenoh.tls
    assert tls is not None
    gate = router_config(config.zenoh.remote)
    gate.insert_json5("connect/endpoints", json.dumps(config.zenoh.local[:1]))
    gate.insert_json5("transport/unicast/max_sessions", str(MAX_CLIENTS + 1))
    gate.insert_json5("transport/link/rx/max_message_size", str(MAX_MESSAGE_BYTES))
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
