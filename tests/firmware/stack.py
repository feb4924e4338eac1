"""What stack protocol and core take at most, from gcc's own account of calls and frames.

`python -m tests.firmware.stack` prints it for the processor of the boards.
"""

import re
import sys
import tempfile
from functools import cache
from pathlib import Path

from tests.firmware.library import FIRMWARE, needs, run, sources

ENTRIES = ("bridge_init", "bridge_on_tick", "bridge_on_received", "bridge_poll")
LIBRARY_BYTES = 64
"""Allowed for a function of the compiler's own library (memcpy, 64-bit division)."""
BOARD = "__indirect_call"
"""A call of one of the board's functions; its stack is the board's to count."""
_NODE = re.compile(r'^node: \{ title: "([^"]+)" label: "([^"]*)"', re.MULTILINE)
_EDGE = re.compile(r'^edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', re.MULTILINE)
_FRAME = re.compile(r"(\d+) bytes \((\w+)\)")


def compile_for_the_board(folder: Path) -> list[Path]:
    """Compile protocol and core as for a Cortex-M4 into `folder`; return the object files."""
    gcc = needs("arm-none-eabi-gcc", "gcc-arm-none-eabi")
    run(
        gcc, "-mcpu=cortex-m4", "-mthumb", "-std=c11", "-Os", "-ffreestanding", "-Wall", "-Werror",
        "-fcallgraph-info=su", f"-I{FIRMWARE}", "-c", *sources(), cwd=folder,
    )  # fmt: skip
    return sorted(folder.glob("*.o"))


class Calls:
    """Who calls whom, and what stack each takes."""

    def __init__(self, folder: Path) -> None:
        self.frames: dict[str, int] = {}
        self.calls: dict[str, set[str]] = {}
        for path in folder.glob("*.ci"):
            text = path.read_text()
            for name, label in _NODE.findall(text):
                found = _FRAME.search(label)
                if found:
                    assert found[2] == "static", f"{name}: stack that depends on its input"
                    self.frames[name] = int(found[1])
            for caller, called in _EDGE.findall(text):
                self.calls.setdefault(caller, set()).add(called)

    def depth(self, entry: str) -> int:
        """Return the bytes of stack that `entry` takes at most; recursion fails."""

        @cache
        def below(name: str) -> int:
            if name == BOARD:
                return 0
            if name not in self.frames:
                return LIBRARY_BYTES
            called = self.calls.get(name, set())
            return self.frames[name] + max(map(below, called), default=0)

        self._refuse_recursion(entry, ())
        return below(entry)

    def _refuse_recursion(self, name: str, path: tuple[str, ...]) -> None:
        assert name not in path, f"recursion: {' -> '.join((*path, name))}"
        for called in self.calls.get(name, ()):
            self._refuse_recursion(called, (*path, name))


def depths(folder: Path) -> dict[str, int]:
    """Return the greatest depth of each entry, from what compile_for_the_board left there."""
    calls = Calls(folder)
    return {entry: calls.depth(entry) for entry in ENTRIES}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        compile_for_the_board(Path(name))
        for entry, size in depths(Path(name)).items():
            sys.stdout.write(f"{entry:20} {size:4} bytes\n")
