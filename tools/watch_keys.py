#!/usr/bin/env python3
"""Write the table of keys in docs/watch.md from the keys of `motord watch`.

Run it after a change of the keys. `--check` only says whether the page is up to date.
"""

import re
import sys
from pathlib import Path

from motord.cli.bench.watch import keys

PAGE = Path(__file__).resolve().parent.parent / "docs/watch.md"
MARK = "<!-- keys: made by tools/watch_keys.py -->"


def page_text(text: str) -> str:
    """Return the page with its table made anew."""
    rows = [f"| {keys.names(key)} | {key.meaning} |" for key in keys.KEYS]
    table = "\n".join(["| keys | what they do |", "|---|---|", *rows])
    text, found = re.subn(
        rf"({re.escape(MARK)}\n\n)(?:\|.*\n)*", lambda m: f"{m[1]}{table}\n", text
    )
    if found != 1:
        raise SystemExit(f"{PAGE}: the line {MARK} has to be there once")
    return text


def main(arguments: list[str]) -> int:
    """Write the page, or with `--check` compare it; return the exit code."""
    text = PAGE.read_text(encoding="utf-8")
    if arguments == ["--check"]:
        if page_text(text) == text:
            return 0
        sys.stderr.write(f"{PAGE} does not have the keys as they are; run tools/watch_keys.py\n")
        return 1
    PAGE.write_text(page_text(text), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
