"""The roles file: which certificate may do what. TOML, `[roles]`, common name = role."""

import json
import re
import shlex
from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path

from motord.atomic_write import write_whole
from motord.untrusted import parse_toml, read_text


class SecurityError(Exception):
    """A file of access that is missing or wrong; the message says which and what to do."""


NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.@-]{0,62}")
"""What a certificate may be called: it is a common name, a key of TOML and a name of a folder."""

ROLES = "roles.toml"
"""What the roles file of an authority is called."""

HEADER = """\
# Common name of a certificate = what it may do: "viewer" (watch) or "operator" (watch and command).
# A name that is not here may do nothing, however good its certificate. Changes count at once.
[roles]
"""


class Role(StrEnum):
    """What somebody on another computer may do."""

    VIEWER = "viewer"
    OPERATOR = "operator"


def check_name(name: str) -> str:
    """Return `name` if a certificate may be called so. Raises SecurityError."""
    if not NAME.fullmatch(name):
        raise SecurityError(
            f"'{name}' cannot be a name: letters, digits and _ . @ - (63 at most), no blank"
        )
    return name


def read(path: Path) -> dict[str, Role]:
    """Return the roles by common name. Raises SecurityError."""
    try:
        content = parse_toml(read_text(path))
    except OSError as error:
        advice = _advice(path) if isinstance(error, FileNotFoundError) else ""
        raise SecurityError(f"{path}: cannot read the roles: {error.strerror}{advice}") from None
    except ValueError as error:
        raise SecurityError(f"{path}: not valid TOML: {error}") from None
    table = content.get("roles")
    if not isinstance(table, dict) or content.keys() != {"roles"}:
        raise SecurityError(f"{path}: expected one table [roles] of names and roles")
    return {name: _role(path, name, role) for name, role in table.items()}


def _advice(path: Path) -> str:
    """Return where a roles file comes from: `init` makes that of an authority, and it alone."""
    if path.name != ROLES or (path.parent / "ca.pem").exists():
        return '; write it: the line [roles], then NAME = "viewer" or "operator" of each'
    return f"; `motord security init {shlex.quote(str(path.parent))}` makes an authority"


def _role(path: Path, name: str, role: object) -> Role:
    known = ", ".join(f'"{role}"' for role in Role)
    if not NAME.fullmatch(name):
        raise SecurityError(f"{path}: '{name}' is no name of a certificate")
    if not isinstance(role, str) or role not in tuple(Role):
        raise SecurityError(f"{path}: {name} = {role!r}: a role is one of {known}")
    return Role(role)


def write(path: Path, roles: Mapping[str, Role]) -> None:
    """Write the roles file, or replace it in one step."""
    lines = "".join(f'{json.dumps(name)} = "{role}"\n' for name, role in roles.items())
    write_whole(path, HEADER + lines)
