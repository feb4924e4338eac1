"""What clients may do, as Zenoh's own access control: the rules of the daemon and of the gateway.

What is not allowed is denied. A client, wherever it is, may ask, subscribe and look who is alive;
it may never publish, answer or declare anything in the name of the bench. Clients connect to the
gateway by TLS and are known by the common name of their certificate; the gateway connects to the
daemon over the loopback interface or a Unix socket.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from motord.security.roles import Role

WATCHED = ("state", "tick", "ticks", "event", "plan", "mesh")
"""Keys that are subscribed to, or asked for the newest."""
READ = (
    "rpc/plan/list", "rpc/config", "rpc/calibration/list", "rpc/calibration/show", "rpc/queue/list",
)  # fmt: skip
"""Requests that change nothing."""
COMMANDS = "rpc/**"

_ALL = (
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)

DOCUMENTS = ("state", "event", "plan", "mesh")
"""Keys that are asked for the newest, also by whoever does not know the bench's name."""
_SENDS = ("declare_subscriber", "liveliness_query", "declare_liveliness_subscriber")
"""What a client sends besides queries."""
_RECEIVES = ("put", "reply", "declare_queryable", "liveliness_token")
"""What a client receives."""
_TO_DAEMON = (
    {"id": "daemon", "interfaces": ["lo"], "link_protocols": ["tcp"]},
    {"id": "daemon_socket", "link_protocols": ["unixsock-stream"]},
)
"""How the gateway reaches the daemon; it listens on TLS alone, so no client comes in this way."""


def daemon_access_control(bench: str, requests: Iterable[str]) -> dict[str, Any]:
    """Return `access_control` of the Zenoh configuration of the daemon's own router.

    The same for everybody who connects: the gateway, programs of this machine, in whatever mode of
    Zenoh. The daemon's own session is the router itself and passes no link. `requests` are asked
    for by their full name: a query by wildcard would come to all of them.
    """
    root = f"motord/{bench}"
    asked = [f"{where}/{name}" for where in (root, "motord/*") for name in DOCUMENTS]
    asked += [f"{root}/rpc/{name}" for name in requests]
    rules = [
        _rule("listens", ("ingress",), _SENDS, ["**"]),
        _rule("asks", ("ingress",), ("query",), asked),
        _rule("receives", ("egress",), _RECEIVES, [f"{root}/**"]),
    ]
    policy = {"rules": [rule["id"] for rule in rules], "subjects": ["anyone"]}
    return _enabled(rules, [{"id": "anyone"}], [policy])


def access_control(bench: str, roles: Mapping[str, Role]) -> dict[str, Any]:
    """Return `access_control` of the Zenoh configuration of the gateway of `bench`."""
    root = f"motord/{bench}"
    watched = [f"{root}/{name}" for name in (*WATCHED, *READ)]
    alive = [f"{root}/alive", "motord/*/alive"]
    rules = [
        _rule("everything", ("ingress", "egress"), _ALL, ["**"]),
        _rule("watch", ("ingress",), ("declare_subscriber", "query"), watched),
        _rule("watched", ("egress",), ("put", "reply", "declare_queryable"), watched),
        _rule("look", ("ingress",), ("liveliness_query", "declare_liveliness_subscriber"), alive),
        _rule("alive", ("egress",), ("liveliness_token", "reply"), [f"{root}/alive"]),
        _rule("command", ("ingress",), ("query",), [f"{root}/{COMMANDS}"]),
        _rule("answered", ("egress",), ("reply", "declare_queryable"), [f"{root}/{COMMANDS}"]),
    ]
    subjects: list[dict[str, Any]] = [dict(subject) for subject in _TO_DAEMON]
    policies: list[dict[str, Any]] = [
        {"rules": ["everything"], "subjects": [subject["id"] for subject in _TO_DAEMON]}
    ]
    look = ["watch", "watched", "look", "alive"]
    for role, allowed in ((Role.VIEWER, look), (Role.OPERATOR, [*look, "command", "answered"])):
        names = [name for name, given in roles.items() if given is role]
        if names:
            subjects.append(
                {"id": str(role), "link_protocols": ["tls"], "cert_common_names": names}
            )
            policies.append({"rules": allowed, "subjects": [str(role)]})
    return _enabled(rules, subjects, policies)


def permits(role: str, name: str) -> bool:
    """Return whether the gateway lets `role` ask for `name`, such as `rpc/stop`."""
    return role == Role.OPERATOR or name in (*WATCHED, *READ)


def _enabled(
    rules: list[dict[str, Any]], subjects: list[dict[str, Any]], policies: list[dict[str, Any]]
) -> dict[str, Any]:
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rule(
    name: str, flows: tuple[str, ...], messages: tuple[str, ...], keys: list[str]
) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": list(flows),
        "messages": list(messages),
        "key_exprs": keys,
    }
