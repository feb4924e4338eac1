"""Ports of the loopback that no other test gets, however many run at the same time.

A port that was bound and released may be handed out again before its owner binds it. Here each is
taken from a range below that of the kernel's own choices, and stays locked (a byte of one file)
for as long as this process lives.
"""

import fcntl
import os
import socket
import tempfile
from contextlib import closing, suppress
from pathlib import Path

RANGE = range(20_000, 30_000)
LOCKS = Path(tempfile.gettempdir()) / f"motord-test-ports-{os.getuid()}"

DEFAULT_PORTS = (7447, 8765, 43117, 15020, 15021, 43118, 15030, 15031)
"""Of daemon, Foxglove bridge, and the emulated devices of config/."""

_taken: dict[int, list[int]] = {}
"""By process, as a forked one inherits no locks: the file, then the ports."""


def free_port() -> int:
    """Return a port that is free for TCP and UDP, and stays this process's."""
    mine = _taken.setdefault(os.getpid(), [])
    if not mine:
        mine.append(os.open(LOCKS, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600))
    file, ports = mine[0], mine[1:]
    begin = ports[-1] + 1 - RANGE.start if ports else os.getpid() * 97
    for step in range(len(RANGE)):
        port = RANGE[(begin + step) % len(RANGE)]
        if port not in ports and _locked(file, port):
            mine.append(port)
            return port
    raise AssertionError(f"every port of {RANGE} is in use")


def default_ports_taken() -> list[socket.socket]:
    """Take the ports that motord has by default, for as long as the sockets are kept.

    A test that uses one meets whoever else does: another run of tests, a bench on this computer.
    It fails like this whether or not there is one. Nobody listens; who connects is refused. For
    continuous integration alone: on the computer of a bench its daemon could not start meanwhile.
    """
    taken = []
    for port in DEFAULT_PORTS:
        for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
            taken.append(socket.socket(socket.AF_INET, kind))
            with suppress(OSError):  # another program has it: all the better
                taken[-1].bind(("", port))
    return taken


def _locked(file: int, port: int) -> bool:
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, port)
    except OSError:
        return False
    for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
        with closing(socket.socket(socket.AF_INET, kind)) as probe:
            try:
                probe.bind(("", port))
            except OSError:  # a program that is no test has it
                fcntl.lockf(file, fcntl.LOCK_UN, 1, port)
                return False
    return True
