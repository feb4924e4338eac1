"""A pseudo-terminal that looks like the serial port named in the bench file."""

import hashlib
import os
import socket
import tty
from contextlib import suppress
from pathlib import Path

from motord.emulate import EmulatorError

BACKLOG_BYTES = 4096
"""Bytes kept for a host that is behind, besides those the kernel keeps; more are lost."""


class Pty:
    """The device's end of a pseudo-terminal; the host opens `link`, a symlink to the other end."""

    def __init__(self, link: Path) -> None:
        """Open a pseudo-terminal in raw mode and make the symlink. Raises EmulatorError."""
        self._owner = _own(link)
        self._link = link
        self._device_fd = self._host_fd = -1
        try:
            _clear(link)
            self._open()
        except (OSError, EmulatorError) as error:
            self.close()
            if isinstance(error, EmulatorError):
                raise
            raise EmulatorError(
                f"{link}: cannot make the serial port there: {error.strerror}; "
                "name a port in a folder that you may write"
            ) from error

    def _open(self) -> None:
        self._backlog = b""
        self._device_fd, self._host_fd = os.openpty()
        tty.setraw(self._host_fd)
        os.set_blocking(self._device_fd, False)
        self.name = os.ttyname(self._host_fd)
        self._link.symlink_to(self.name)

    def fileno(self) -> int:
        """Return the descriptor of the device's end."""
        return self._device_fd

    def read(self) -> bytes:
        """Return what the host sent since the last call, without waiting."""
        try:
            return os.read(self._device_fd, 65_536)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> bool:
        """Send `data` whole, without waiting; False if there is no room for it."""
        fits = len(self._backlog) + len(data) <= BACKLOG_BYTES
        data = self._backlog + (data if fits else b"")
        try:
            self._backlog = data[os.write(self._device_fd, data) :]
        except BlockingIOError:
            self._backlog = data
        return fits

    def close(self) -> None:
        """Remove the symlink, if it is still ours, and close; may be called twice."""
        self._owner.close()
        if self._device_fd < 0:
            return
        with suppress(OSError):
            if str(self._link.readlink()) == self.name:
                self._link.unlink()
        os.close(self._device_fd)
        os.close(self._host_fd)
        self._device_fd = self._host_fd = -1


def _own(link: Path) -> socket.socket:
    """Claim `link` for this process, until the socket closes. Raises EmulatorError."""
    digest = hashlib.sha256(os.fsencode(link.absolute())).hexdigest()
    owner = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        owner.bind(f"\0motord-pty-{digest}")  # abstract: no file, gone with the process
    except OSError:
        owner.close()
        raise EmulatorError(f"{link}: another emulator is serving this port; stop it") from None
    return owner


def _clear(link: Path) -> None:
    """Remove the symlink that an emulator left behind. Raises EmulatorError for anything else."""
    if not link.is_symlink():
        if link.exists():
            raise EmulatorError(
                f"{link}: exists and is not a symlink; the emulator does not replace it: "
                "choose another port in the bench file"
            )
        return
    target = str(link.readlink())
    if not target.startswith("/dev/pts/"):
        raise EmulatorError(
            f"{link}: a symlink to {target}, which is not a pseudo-terminal; the emulator does "
            "not replace it: choose another port in the bench file"
        )
    link.unlink()
