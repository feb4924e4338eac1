"""The files that a bench file names: where they are, and as they were when the daemon read them."""

import hashlib
from collections.abc import Iterator
from contextlib import suppress
from importlib import resources
from pathlib import Path
from typing import Any

from motord.atomic_write import write_cached
from motord.untrusted import parse_toml, read_bytes

ACCESS = ("zenoh", "tls")
"""The table of who gets in: its files are never kept, a private key among them."""
_FILES = (
    ("bench", "rig"),
    ("bench", "faults"),
    ("inverter", "can", "dbc"),
    ("motor", "back_emf"),
    *((*ACCESS, name) for name in ("ca", "certificate", "key", "roles")),
)
"""Keys that name files, if they hold text."""


def named_files(data: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str, str]]:
    """Yield table, key and name of each file that the content of a bench file names."""
    for *tables, key in _FILES:
        table: Any = data
        for name in tables:
            table = table.get(name) if isinstance(table, dict) else None
        if isinstance(table, dict) and isinstance(table.get(key), str | Path):
            yield table, key, str(table[key])
    channels = data.get("channels")
    for channel in channels if isinstance(channels, list) else ():
        source = channel.get("source") if isinstance(channel, dict) else None
        if isinstance(source, dict) and isinstance(source.get("dbc"), str | Path):
            yield source, "dbc", str(source["dbc"])


def packaged(name: str) -> Path:
    """Return the path of a data file that ships with motord."""
    return Path(str(resources.files("motord") / "data" / name))


def resolve(base: Path, file: Path) -> Path:
    """Return `file` as seen from the folder of `base`; `package:NAME` is one that motord ships."""
    name = str(file)
    if name.startswith("package:"):
        return packaged(name.removeprefix("package:"))
    return file if file.is_absolute() else base.parent / file


def keep(path: Path, text: str, kept: Path) -> None:
    """Keep the text of the bench file at `path` as `kept`, and next to it copies of what it names.

    So a process that is started again goes on with what the others read. A file of which no copy
    can be had or kept, for want of space say, is read anew. Raises OSError for `kept` itself.
    """
    write_cached(kept, text)
    content = parse_toml(text)
    content.get(ACCESS[0], {}).pop(ACCESS[1], None)
    for _, _, name in named_files(content):
        file = resolve(path, Path(name))
        with suppress(OSError):  # who needs a file that cannot be read says what is wrong with it
            write_cached(_copy(file, kept), read_bytes(file))


def as_kept(file: Path, kept: Path) -> Path:
    """Return the file, or its copy next to `kept` if there is one and the file changed since."""
    copy = _copy(file, kept)
    if not copy.exists():
        return file
    with suppress(OSError):
        if read_bytes(file) == read_bytes(copy):
            return file
    return copy


def _copy(file: Path, kept: Path) -> Path:
    digest = hashlib.sha256(str(file).encode()).hexdigest()
    return kept.with_name(f"{digest[:16]}-{file.name[-64:]}.named")
