"""What stack protocol and core take at most, from gcc's own account of calls and frames.

`python -m tests.firmware.stack` prints it for the processor of the boards. What the board's own
functions take comes on top (`test_boards.py` counts whole images).
"""

import sys
import tempfile
from pathlib import Path

from tests.firmware.call_depth import CallGraph
from tests.firmware.library import FIRMWARE, needs, run, sources

ENTRIES = ("bridge_init", "bridge_on_tick", "bridge_on_received", "bridge_poll")


def compile_for_the_board(folder: Path) -> list[Path]:
    """Compile protocol and core as for a Cortex-M4 into `folder`; return the object files."""
    gcc = needs("arm-none-eabi-gcc", "gcc-arm-none-eabi")
    run(
        gcc, "-mcpu=cortex-m4", "-mthumb", "-std=c11", "-Os", "-ffreestanding", "-Wall", "-Werror",
        "-fcallgraph-info=su", f"-I{FIRMWARE}", "-c", *sources(), cwd=folder,
    )  # fmt: skip
    return sorted(folder.glob("*.o"))


def depths(folder: Path) -> dict[str, int]:
    """Return the bytes each entry takes at most, from what compile_for_the_board left there."""
    graph = CallGraph(folder, ())
    assert graph.kinds == {"static"}, "stack that depends on what comes in"
    return {entry: graph.depth(entry) for entry in ENTRIES}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        compile_for_the_board(Path(name))
        for entry, size in depths(Path(name)).items():
            sys.stdout.write(f"{entry:20} {size:4} bytes\n")
