"""Who may come in: tokens of operator and viewer, and requests of this server's own page alone."""

import hmac
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from motord.security.roles import Role

OWN_NAMES = ("127.0.0.1", "localhost", "::1")
"""Names of this machine; a name that was made to lead here (DNS rebinding) is another."""
_TOKEN_BYTES = 32


def _new_token() -> str:
    return secrets.token_urlsafe(_TOKEN_BYTES)


@dataclass(frozen=True)
class Tokens:
    """The two secrets of a server, made at its start; the operator's is for `role_max`."""

    role_max: Role = Role.OPERATOR
    operator: str = field(default_factory=_new_token)
    viewer: str = field(default_factory=_new_token)

    def role(self, token: str) -> Role | None:
        """Return what whoever shows `token` may do, None for a wrong one; in constant time."""
        given = token.encode()
        operator = hmac.compare_digest(given, self.operator.encode())
        viewer = hmac.compare_digest(given, self.viewer.encode())
        if operator:
            return self.role_max
        return Role.VIEWER if viewer else None


def foreign(headers: Mapping[str, str]) -> str:
    """Return why a request does not come from this server's own page, "" if it does.

    Ports differ behind `ssh -L`; names do not. An Origin must be the Host itself.
    """
    host = headers.get("host", "")
    try:
        name = urlsplit(f"//{host}").hostname
    except ValueError:
        name = None
    if name not in OWN_NAMES:
        return f"Host is {host or 'missing'}: use the address that `motord dashboard` prints"
    origin = headers.get("origin")
    if origin is not None and origin != f"http://{host}":
        return f"Origin {origin} is not this server's page"
    return ""
