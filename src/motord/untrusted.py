"""Files, JSON and TOML from others: bounded in size, with two kinds of error only.

A path that a user names may lead to a device that never ends, and a text may be nested as deep as
Python's stack or have numbers of thousands of digits. Whatever it is, a file that cannot be used is
an OSError and a text that cannot be understood is a ValueError.
"""

import errno
import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

SIZE_MAX = 1 << 26
"""Bytes of a file that is read whole; a calibration for an encoder of 2^20 counts has 25 MB."""

LINE_SHOWN = 60
"""Characters of a wrong line that an error shows."""

_Text = TypeVar("_Text", str, bytes, str | bytes)


def read_bytes(path: Path) -> bytes:
    """Return what is in a file. Raises OSError, also for more than SIZE_MAX."""
    try:
        with path.open("rb") as file:
            content = file.read(SIZE_MAX + 1)
    except ValueError as error:  # a zero byte in the path
        raise OSError(errno.EINVAL, "no path of a file", str(path)) from error
    if len(content) > SIZE_MAX:
        raise OSError(errno.EFBIG, f"larger than {SIZE_MAX >> 20} MB", str(path))
    return content


def read_text(path: Path, encoding: str = "utf-8-sig", errors: str = "strict") -> str:
    r"""Return the text of a file with \n at the end of lines, without a mark of byte order.

    Raises OSError, UnicodeDecodeError.
    """
    text = read_bytes(path).decode(encoding, errors)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def parse_json(text: str | bytes) -> Any:
    """Return what a text in JSON holds. Raises ValueError."""
    return _parsed(json.loads, text)


def parse_toml(text: str) -> dict[str, Any]:
    """Return what a text in TOML holds. Raises ValueError, which shows the line that is wrong."""
    try:
        content: dict[str, Any] = _parsed(tomllib.loads, text)
    except tomllib.TOMLDecodeError as error:
        place = re.search(r"at line (\d+), column \d+\)$", str(error))
        line = text.split("\n")[int(place[1]) - 1].strip() if place else ""
        shown = f": {line[:LINE_SHOWN]}{_toml_hint(line)}" if line else ""
        raise ValueError(f"{error}{shown}") from None
    return content


def _toml_hint(line: str) -> str:
    """Return what is usually meant by a value that TOML does not have."""
    value = line.partition("=")[2].strip()
    hints = (
        (r"[-+]?\d+,\d", "a number has a decimal point, not a comma"),
        (r"(?i)(yes|no|on|off|true|false)\b", "it is true or false, in small letters"),
        (r"[^\W\d]", 'text is in quotes, "..."'),
    )
    return next((f"; {hint}" for pattern, hint in hints if re.match(pattern, value)), "")


def _parsed(parse: Callable[[_Text], Any], text: _Text) -> Any:
    try:
        return parse(text)
    except (json.JSONDecodeError, tomllib.TOMLDecodeError, UnicodeDecodeError):
        raise
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except ValueError:
        raise ValueError("a number has thousands of digits") from None
