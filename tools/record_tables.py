#!/usr/bin/env python3
"""Make the tables of docs/recording.md from the records that `motord.schema` defines.

Run it after a change of the schema. `--check` only says whether the page is up to date.
"""

import re
import sys
from pathlib import Path

from motord.schema import TICK, TRUTH, Record

PAGE = Path(__file__).resolve().parent.parent / "docs/recording.md"


def table(record: Record) -> str:
    """Return the fields of `record` as a table in Markdown."""
    lines = ["| no. | field | type | unit | meaning |", "|---|---|---|---|---|"]
    lines += [
        f"| {f.number} | `{f.name}` | {f.kind} | {f.unit} | {f.meaning} |" for f in record.fields
    ]
    return "\n".join(lines)


def page_text(text: str) -> str:
    """Return the page with its tables made anew."""
    for record in (TICK, TRUTH):
        mark = f"<!-- {record.name}: made by tools/record_tables.py -->"
        text, found = re.subn(
            rf"({re.escape(mark)}\n\n)(?:\|.*\n)*", lambda m, r=record: f"{m[1]}{table(r)}\n", text
        )
        if found != 1:
            raise SystemExit(f"{PAGE}: the line {mark} has to be there once")
    return text


def main(arguments: list[str]) -> int:
    """Write the page, or with `--check` compare it; return the exit code."""
    text = PAGE.read_text(encoding="utf-8")
    if arguments == ["--check"]:
        if page_text(text) == text:
            return 0
        sys.stderr.write(f"{PAGE} is not what the schema makes; run tools/record_tables.py\n")
        return 1
    PAGE.write_text(page_text(text), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
