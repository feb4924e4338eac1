"""Values as TOML, and written into the text of a bench file with everything else left as it is."""

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

from motord.config.base import ConfigError
from motord.untrusted import parse_toml

Value = str | int | float

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def toml_value(value: Any) -> str:
    """Return a bool, number, text, list or mapping as TOML on one line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        pairs = (f"{toml_key(key)} = {toml_value(one)}" for key, one in value.items())
        return f"{{{', '.join(pairs)}}}"
    if isinstance(value, Sequence):
        return f"[{', '.join(map(toml_value, value))}]"
    return repr(value)


def toml_key(key: str) -> str:
    """Return a key of TOML, in quotes where it needs them."""
    return key if _BARE_KEY.fullmatch(key) else toml_value(key)


def with_table(text: str, table: str) -> str:
    """Return a TOML `text` that has `[table]`: an empty one is added at its end if it has none."""
    return text if table in parse_toml(text) else f"{text.rstrip()}\n\n[{table}]\n"


def with_values(text: str, table: str, values: Mapping[str, Value], where: str) -> str:
    """Return a TOML `text` in which `[table]` has `values`; comments and order stay.

    A key that is there gets the new value in its line, others come right under the table's head.
    Raises ConfigError, beginning with `where`, if the text does not allow it: no such table, or a
    value that is not on a line of its own.
    """
    lines = text.splitlines()
    is_head = re.compile(rf"\s*\[\s*{re.escape(table)}\s*\]\s*(#.*)?")
    try:
        wanted = parse_toml(text)
        head = next(n for n, line in enumerate(lines) if is_head.fullmatch(line))
    except (ValueError, StopIteration):
        raise ConfigError(f"{where}: there is no table [{table}] to write to") from None
    missing = []
    for key, value in values.items():
        place = _line_of(lines, head, key)
        if place is None:
            missing.append(f"{key} = {toml_value(value)}")
        else:
            lines[place] = f"{key} = {toml_value(value)}{_comment(lines[place])}"
        wanted[table][key] = value
    lines[head + 1 : head + 1] = missing
    edited = "\n".join(lines) + "\n"
    try:
        understood = parse_toml(edited) == wanted
    except ValueError:
        understood = False
    if not understood:
        keys = ", ".join(f"{key} = {toml_value(value)}" for key, value in values.items())
        raise ConfigError(f"{where}: cannot be changed safely; write into [{table}]: {keys}")
    return edited


def _line_of(lines: list[str], head: int, key: str) -> int | None:
    for number in range(head + 1, len(lines)):
        if re.match(r"\s*\[\[?[A-Za-z]", lines[number]):
            return None
        if re.match(rf"\s*{re.escape(key)}\s*=", lines[number]):
            return number
    return None


def _comment(line: str) -> str:
    """Return the comment of a line with a value that has no # in it, with two spaces before."""
    found = re.search(r"#.*$", line)
    return f"  {found.group()}" if found else ""
