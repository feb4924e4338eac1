#!/usr/bin/env python3
"""Make src/motord/wire/bridge/layout.py from the header that defines the bridge's frames.

Run it after a change of firmware_bridge/protocol/bridge_frames.h. `--check` only says whether the
module is up to date.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
HEADER = ROOT / "firmware_bridge/protocol/bridge_frames.h"
MODULE = ROOT / "src/motord/wire/bridge/layout.py"

_PREAMBLE = '''"""Layouts of the frames between host and bridge board.

Made by tools/bridge_layout.py from firmware_bridge/protocol/bridge_frames.h: change that.
"""

PROTOCOL = {protocol}
"""Version that both sides name in `HelloRequest` and `Hello`."""

LAYOUTS = {{
{rows}}}
"""Of each frame its type byte, and the widths of its fields as `struct` writes them."""
'''


def _macro(header: str, name: str) -> str:
    """Return the body of the macro `name`, continuation lines joined."""
    found = re.search(rf"^#define {name}(?:\(\w+\))?((?:.*\\\n)*.*)$", header, re.MULTILINE)
    if found is None:
        raise SystemExit(f"{HEADER}: no macro {name}")
    return found[1].replace("\\\n", " ")


def module_text(header: str) -> str:
    """Return the module that the header's text makes."""
    rows = ""
    for code, name in re.findall(r"FRAME\((\d+), (\w+)\)", _macro(header, "BRIDGE_FRAMES")):
        letters = re.findall(r"FIELD\((\w+), \w+\)", _macro(header, f"BRIDGE_FIELDS_{name}"))
        rows += f'    "{name}": (0x{int(code):02X}, "{"".join(letters)}"),\n'
    return _PREAMBLE.format(protocol=int(_macro(header, "BRIDGE_PROTOCOL")), rows=rows)


def main(arguments: list[str]) -> int:
    """Write the module, or with `--check` compare it; return the exit code."""
    text = module_text(HEADER.read_text(encoding="utf-8"))
    if arguments == ["--check"]:
        if MODULE.read_text(encoding="utf-8") == text:
            return 0
        sys.stderr.write(f"{MODULE} is not what {HEADER} makes; run tools/bridge_layout.py\n")
        return 1
    MODULE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
