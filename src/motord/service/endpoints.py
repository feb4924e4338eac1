"""Zenoh sessions of the daemon and of its clients: no scouting, only what the config names."""

import json
from collections.abc import Sequence

import zenoh

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
KEY_ROOT = "motord"


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


def client_config(endpoint: str) -> zenoh.Config:
    """Return the configuration of a client of the daemon at `endpoint`; it tries once."""
    config = _quiet()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("connect/timeout_ms", "0")
    config.insert_json5("connect/exit_on_failure", "true")
    return config


def key(bench: str, name: str) -> str:
    """Return the key of `name` of a bench."""
    return f"{KEY_ROOT}/{bench}/{name}"
