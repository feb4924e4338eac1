"""Write docs/reference, or with `--check` say which pages are not what the code makes."""

import sys
from collections.abc import Callable

from tools.code_blocks import REFERENCE
from tools.reference.bench_file import bench_file, import_map
from tools.reference.cli import cli
from tools.reference.interlocks import interlocks
from tools.reference.motor_type import motor_type
from tools.reference.recordings import recordings
from tools.reference.rpc import rpc

PAGES: dict[str, Callable[[], str]] = {
    "cli.md": cli,
    "bench-file.md": bench_file,
    "import-map.md": import_map,
    "motor-type.md": motor_type,
    "rpc.md": rpc,
    "recording.md": recordings,
    "interlocks.md": interlocks,
}


def stale() -> dict[str, str]:
    """Return the pages that are not what the code makes, with what it makes."""
    made = {name: make() for name, make in PAGES.items()}
    return {name: text for name, text in made.items() if _present(name) != text}


def _present(name: str) -> str:
    path = REFERENCE / name
    return path.read_text(encoding="utf-8") if path.exists() else ""


def main(arguments: list[str]) -> int:
    """Write the pages, or with `--check` compare them; return the exit code."""
    pages = stale()
    if arguments == ["--check"]:
        for name in pages:
            sys.stderr.write(f"docs/reference/{name} is not what the code makes: make reference\n")
        return 1 if pages else 0
    REFERENCE.mkdir(exist_ok=True)
    for name, text in pages.items():
        (REFERENCE / name).write_text(text, encoding="utf-8")
        sys.stdout.write(f"wrote docs/reference/{name}\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
