"""Commands to a running emulator: a datagram socket beside the bridge's port, JSON both ways.

A request is a fault as in a timeline; the answer is {"ok": true, ...} or {"error": "..."}.
"""

import json
import os
import socket
from contextlib import suppress
from pathlib import Path
from tempfile import gettempdir
from typing import Any

from pydantic import ValidationError

from motord.config import Config
from motord.config.faults import Fault
from motord.emulate import EmulatorError

BYTES_MAX = 65_536
ANSWER_S = 5.0


def control_path(config: Config) -> Path:
    """Return where the emulator of a bench listens. Raises EmulatorError if it has none."""
    if config.bridge.driver == "can":
        return Path(gettempdir()) / f"motord-{config.bench.name}.control"
    if not config.bridge.port:
        raise EmulatorError(
            f"bench {config.bench.name} is not emulated: [bridge] has no port; name the bench file "
            "of the running emulator (-c FILE)"
        )
    return Path(config.bridge.port + ".control")


class ControlSocket:
    """The emulator's end. The caller answers each request."""

    def __init__(self, path: Path) -> None:
        """Listen; only this user may send. Raises EmulatorError."""
        self._path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        try:
            path.unlink(missing_ok=True)
            before = os.umask(0o177)
            try:
                self._socket.bind(str(path))
            finally:
                os.umask(before)
        except OSError as error:
            self._socket.close()
            raise EmulatorError(
                f"{path}: cannot listen for commands: {error.strerror or error}"
            ) from error

    def fileno(self) -> int:
        """Return the descriptor that is readable when a command has come."""
        return self._socket.fileno()

    def receive(self) -> tuple[Fault | str, str] | None:
        """Return a fault, or what is wrong with the request, and whom to answer; None: no more."""
        try:
            data, sender = self._socket.recvfrom(BYTES_MAX)
        except BlockingIOError:
            return None
        try:
            return Fault.model_validate(json.loads(data)), sender
        except ValidationError as error:
            return "; ".join(_said(item) for item in error.errors()), sender
        except (ValueError, RecursionError):
            return "not JSON", sender

    def answer(self, receiver: str, answer: dict[str, Any]) -> None:
        """Answer, if whoever asked still listens."""
        with suppress(OSError):
            self._socket.sendto(json.dumps(answer).encode(), receiver)

    def close(self) -> None:
        """Stop listening and remove the socket."""
        self._socket.close()
        self._path.unlink(missing_ok=True)


def _said(item: Any) -> str:
    where = ".".join(str(key) for key in item["loc"])
    what = str(item["msg"]).removeprefix("Value error, ")
    return f"{where}: {what}" if where else what


def inject(config: Config, fault: dict[str, Any]) -> dict[str, Any]:
    """Send a fault to the running emulator of a bench; return its answer. Raises EmulatorError."""
    path = control_path(config)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ours:
        ours.bind("")  # an abstract address of our own, for the answer
        ours.settimeout(ANSWER_S)
        try:
            ours.sendto(json.dumps(fault).encode(), str(path))
            answer: dict[str, Any] = json.loads(ours.recv(BYTES_MAX))
        except TimeoutError:
            raise EmulatorError(f"{path}: the emulator does not answer") from None
        except OSError as error:
            raise EmulatorError(
                f"{path}: no emulator of this bench listens ({error.strerror}); "
                "start `motord emulate` first"
            ) from error
    if "error" in answer:
        raise EmulatorError(str(answer["error"]))
    return answer
