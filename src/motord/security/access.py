"""What each role may do, as Zenoh's own access control: the rules of the gate.

What is not allowed is denied. Traffic comes in over TLS from clients, who are known by the common
name of their certificate, and goes on over the loopback interface to the daemon. A client may never
publish, answer or declare anything in the name of the bench.
"""

from collections.abc import Mapping
from typing import Any

from motord.security.roles import Role

WATCHED = ("state", "tick", "ticks", "event", "plan")
"""Keys that are subscribed to, or asked for the newest."""
READ = ("rpc/plan/list", "rpc/config")
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


def access_control(bench: str, roles: Mapping[str, Role]) -> dict[str, Any]:
    """Return `access_control` of the Zenoh configuration of the gate of `bench`."""
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
    subjects: list[dict[str, Any]] = [
        {"id": "daemon", "interfaces": ["lo"], "link_protocols": ["tcp"]}
    ]
    policies: list[dict[str, Any]] = [{"rules": ["everything"], "subjects": ["daemon"]}]
    look = ["watch", "watched", "look", "alive"]
    for role, allowed in ((Role.VIEWER, look), (Role.OPERATOR, [*look, "command", "answered"])):
        names = [name for name, given in roles.items() if given is role]
        if names:
            subjects.append(
                {"id": str(role), "link_protocols": ["tls"], "cert_common_names": names}
            )
            policies.append({"rules": allowed, "subjects": [str(role)]})
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
