"""Name of the lease's holder: user, host, terminal and process."""

import getpass
import os
import re
import socket
from contextlib import suppress

LENGTH_MAX = 64
"""Of a holder's name: the daemon accepts no longer one."""
_NOT_ALLOWED = re.compile(r"[^\w.@:/ -]")


def operator() -> str:
    """Return user and host, terminal and process: `anna@bench pts/3 4711`.

    Two terminals of one user are two holders. Without a terminal that part is left out.
    """
    terminal = _terminal()
    own = f" {terminal} {os.getpid()}" if terminal else f" {os.getpid()}"
    return _NOT_ALLOWED.sub("_", user_and_host()[: LENGTH_MAX - len(own)] + own)


def user_and_host() -> str:
    """Return `anna@bench`."""
    return f"{_user()}@{socket.gethostname()}"


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a user without an entry, as in a container
        return f"uid{os.getuid()}"


def _terminal() -> str:
    for descriptor in (0, 1, 2):
        with suppress(OSError):
            return os.ttyname(descriptor).removeprefix("/dev/")
    return ""
