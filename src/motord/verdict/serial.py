"""Serial numbers, and the names of files that are made of them."""

from pathlib import Path
from urllib.parse import quote

NAME_MAX = 120
"""Characters of a serial number in the name of a file: more would not fit, with a time after it."""

TYPE_MAX = 40
"""Characters of a motor type's name there."""


class SerialError(ValueError):
    """A serial number that cannot be used; the message says why."""


def check_serial(serial: str) -> str:
    """Return a serial number as it is. Raises SerialError."""
    if not serial.strip():
        raise SerialError("the serial number is empty")
    if serial != serial.strip():
        raise SerialError(f"the serial number begins or ends with a space: {serial!r}")
    if not serial.isprintable():
        raise SerialError(f"the serial number has characters that cannot be printed: {serial!r}")
    if len(file_part(serial)) > NAME_MAX:
        raise SerialError(
            f"the serial number is too long for the name of a file: {len(serial)} characters; at "
            f"most {NAME_MAX}, of which each but letters of ASCII, digits and -._~ counts 3 or more"
        )
    return serial


def file_part(serial: str) -> str:
    """Return a serial number as part of a file's name: what is not allowed there as %XX.

    Different numbers give different names.
    """
    return quote(serial, safe="")


def note_of(motor: str, serial: str = "") -> str:
    """Return what the notes of a recording say that was made to test a motor."""
    return f"test of {motor}, serial {serial}"


def certificate_name(motor_type: Path, serial: str, time: str) -> str:
    """Return the name of a certificate: type, serial number, time."""
    kind = file_part(motor_type.stem)[:TYPE_MAX].lstrip(".-") or "motor"
    return f"{kind}-{file_part(serial)}-{time}.html"
