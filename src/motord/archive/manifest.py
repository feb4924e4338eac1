"""What the archive knows of one copy: written once the copy was read back, never before."""

import json
import socket
import time
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

from motord.archive.pace import ConflictError
from motord.atomic_write import write_whole
from motord.recording.damage import utc
from motord.untrusted import parse_json

SUFFIX = ".json"


@dataclass(frozen=True)
class ArchiveManifest:
    """verified_ns: when the copy was read back, Unix ns; source: computer and path it is from."""

    file: str
    bytes: int
    sha256: str
    source: str
    source_mtime_ns: int
    verified: str
    verified_ns: int
    motord: str


_TYPES = dict(ArchiveManifest.__annotations__)


def manifest_of(copy: Path) -> Path:
    """Return the path of the manifest of a copy."""
    return copy.with_name(copy.name + SUFFIX)


def write(copy: Path, source: Path, source_mtime_ns: int, sha256: str) -> ArchiveManifest:
    """Write the manifest of a copy that was read back just now. Raises OSError."""
    now_ns = time.time_ns()
    manifest = ArchiveManifest(
        file=copy.name,
        bytes=copy.stat().st_size,
        sha256=sha256,
        source=f"{socket.gethostname()}:{source.absolute()}",
        source_mtime_ns=source_mtime_ns,
        verified=utc(now_ns),
        verified_ns=now_ns,
        motord=version("motord"),
    )
    write_whole(manifest_of(copy), json.dumps(asdict(manifest), indent=2) + "\n")
    return manifest


def read(copy: Path) -> ArchiveManifest | None:
    """Return the manifest of a copy, None if there is none. Raises ConflictError, OSError."""
    path = manifest_of(copy)
    try:
        content = parse_json(path.read_bytes())
        manifest = ArchiveManifest(**content)
        if {name: type(value) for name, value in content.items()} == _TYPES:
            return manifest
    except FileNotFoundError:
        return None
    except (ValueError, TypeError):
        pass
    raise ConflictError(f"{path}: not a manifest of the archive; it is left alone")
