"""Commands to a running emulator: a datagram socket of this user's alone, JSON both ways.

A request is a fault as in a timeline, the response {"ok": true, ...} or {"error": "..."}.
"""

import hashlib
import json
import socket
from contextlib import suppress
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from motord.config import Config
from motord.config.faults import Fault
from motord.emulate import EmulatorError
from motord.process.private_folder import PrivateFolderError, base_directory, make_private
from motord.section.complaints import wrong_things
from motord.untrusted import parse_json

BYTES_MAX = 65_536
RESPONSE_S = 5.0


def control_path(config: Config) -> Path:
    """Return where the emulator of a bench listens. Raises EmulatorError if it has none.

    In the user's own folder, where no other user can listen in its place.
    """
    wire = config.bridge.place
    if not wire:
        raise EmulatorError(
            f"bench {config.bench.name} is not emulated: [bridge] has no port; name the bench file "
            "of the running emulator (-c FILE)"
        )
    digest = hashlib.sha256(f"{config.bench.name} {wire}".encode()).hexdigest()[:16]
    return base_directory() / f"emulator-{digest}"


class ControlSocket:
    """The emulator's end. The caller responds to each request."""

    def __init__(self, path: Path) -> None:
        """Listen; only this user may send. Raises EmulatorError."""
        self._path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        try:
            make_private(path.parent)
            path.unlink(missing_ok=True)
            self._socket.bind(str(path))
            path.chmod(0o600)
        except (OSError, PrivateFolderError) as error:
            self._socket.close()
            reason = getattr(error, "strerror", None) or error
            raise EmulatorError(f"{path}: cannot listen for commands: {reason}") from error

    def fileno(self) -> int:
        """Return the descriptor that is readable when a command has come."""
        return self._socket.fileno()

    def receive(self) -> tuple[Fault | str, str] | None:
        """Return a fault, or what is wrong with the request, and its sender; None: no more."""
        try:
            data, sender = self._socket.recvfrom(BYTES_MAX)
        except BlockingIOError:
            return None
        try:
            return Fault.model_validate(parse_json(data)), sender
        except ValidationError as error:
            return "; ".join(wrong_things(error)), sender
        except ValueError:
            return "not JSON", sender

    def respond(self, receiver: str, response: dict[str, Any]) -> None:
        """Send the response, if the sender of the request still listens."""
        with suppress(OSError):
            self._socket.sendto(json.dumps(response).encode(), receiver)

    def close(self) -> None:
        """Stop listening and remove the socket."""
        self._socket.close()
        self._path.unlink(missing_ok=True)


def inject(config: Config, fault: dict[str, Any]) -> dict[str, Any]:
    """Send a fault to the emulator of a bench; return the response. Raises EmulatorError."""
    path = control_path(config)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ours:
        ours.bind("")  # an abstract address of our own, for the response
        ours.settimeout(RESPONSE_S)
        try:
            make_private(path.parent)
            ours.sendto(json.dumps(fault).encode(), str(path))
            response: dict[str, Any] = parse_json(ours.recv(BYTES_MAX))
        except PrivateFolderError as error:
            raise EmulatorError(str(error)) from error
        except TimeoutError:
            raise EmulatorError(f"{path}: the emulator does not respond") from None
        except OSError as error:
            raise EmulatorError(
                f"{path}: no emulator of this bench listens ({error.strerror}); "
                "start `motord emulate` first"
            ) from error
    if "error" in response:
        raise EmulatorError(str(response["error"]))
    return response
