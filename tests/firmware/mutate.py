"""Mutants of the enable line: every small change of its source has to be noticed.

`python -m tests.firmware.mutate` makes each mutant of `core/enable_line.c`, compiles them, at once
and under names of their own, and plays the histories of `tests.firmware.line_model` with each. It
prints those that live, and fails if there are any. All have to compile.
"""

import re
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import cffi

from tests.firmware import line_model
from tests.firmware.library import FIRMWARE, declarations, needs, run

SOURCE = FIRMWARE / "core/enable_line.c"
PREFIX = re.compile(r"\benable_line_")
"""What the functions of the source begin with."""
STATES = ("LINE_SILENT", "LINE_OPEN", "LINE_CLOSED", "LINE_LOST", "LINE_BARRED")
OPERATORS = {
    "==": ("!=",),
    "!=": ("==",),
    ">=": (">", "<", "<=", "=="),
    "&&": ("||",),
    "||": ("&&",),
    "return;": (";",),
    "} else if (": ("} if (",),
}
Others = Callable[[re.Match[str]], Iterable[str]]
REPLACED: list[tuple[str, Others]] = [
    ("|".join(map(re.escape, OPERATORS)), lambda found: OPERATORS[found[0]]),
    ("|".join(STATES), lambda found: STATES),
    (r"(?<![\w.])\d+\b", lambda found: (str(int(found[0]) + 1),)),
    (r"!(?=\w)|, \.\w+ = \w+", lambda found: ("",)),
    (r"(?<=\bif \().*(?=\) \{$)", lambda found: (f"!({found[0]})", "true", "false")),
    (r"^    (?!const\b).*;$", lambda found: (";",)),
    (
        r"(?:(?<=\w = )(?!LINE_)|(?<=\breturn ))[^;{}]+(?=;$)",
        lambda found: ("0", "1", f"!({found[0]})", f"({found[0]}) + 1"),
    ),
]
"""What is replaced, and by what: operators, states, numbers, conditions, statements, values."""


class Mutant(NamedTuple):
    """A change of one line: its number from 1, what it was, what it is."""

    line: int
    before: str
    after: str


class Outcome(NamedTuple):
    """What became of the mutants; `killed` says by what history."""

    killed: list[tuple[Mutant, str]]
    lived: list[Mutant]


def mutants(source: str) -> list[Mutant]:
    """Return all mutants of the text of a source, each other text once."""
    found: dict[tuple[int, str], Mutant] = {}
    for number, line in enumerate(source.splitlines(), 1):
        if line.startswith("#"):
            continue
        for changed in _changes(line):
            if changed.split() != line.split():
                found.setdefault((number, changed), Mutant(number, line, changed))
    return list(found.values())


def _changes(line: str) -> Iterator[str]:
    for pattern, others in REPLACED:
        for found in re.finditer(pattern, line):
            for other in others(found):
                yield line[: found.start()] + other + line[found.end() :]


def mutated(source: str, mutant: Mutant) -> str:
    """Return the source with the change."""
    lines = source.splitlines()
    assert lines[mutant.line - 1] == mutant.before
    lines[mutant.line - 1] = mutant.after
    return "\n".join(lines) + "\n"


def examine(chosen: list[Mutant], folder: Path) -> Outcome:
    """Compile all mutants, and try each."""
    source = SOURCE.read_text(encoding="utf-8")
    texts = [PREFIX.sub(f"mutant{n}_", mutated(source, one)) for n, one in enumerate(chosen)]
    file, out = folder / "mutants.c", folder / "mutants.so"
    file.write_text("".join(texts), encoding="utf-8")
    gcc = needs("gcc", "gcc")
    run(gcc, "-std=c11", "-w", f"-I{FIRMWARE}", "-fPIC", "-shared", "-o", out, file)
    ffi = cffi.FFI()
    ffi.cdef(declarations())
    prototypes = re.findall(r"^\w+ enable_line_\w+\(.*\);$", declarations(), re.MULTILINE)
    every = "\n".join(prototypes)
    names = re.findall(r"\benable_line_\w+(?=\()", every)
    ffi.cdef("".join(PREFIX.sub(f"mutant{n}_", every) for n in range(len(chosen))))
    lib, outcome = ffi.dlopen(str(out)), Outcome([], [])
    for number, mutant in enumerate(chosen):
        own = {name: getattr(lib, PREFIX.sub(f"mutant{number}_", name)) for name in names}
        if history := line_model.check(ffi, SimpleNamespace(**own), 2, 2000):
            outcome.killed.append((mutant, history))
        else:
            outcome.lived.append(mutant)
    return outcome


def main() -> int:
    """Try all mutants; return the exit code."""
    chosen = mutants(SOURCE.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as name:
        outcome = examine(chosen, Path(name))
    for mutant in outcome.lived:
        sys.stdout.write(f"lives: {SOURCE.name}:{mutant.line}: {mutant.after.strip()}\n")
    sys.stdout.write(
        f"{len(chosen)} mutants: {len(outcome.killed)} killed, {len(outcome.lived)} live\n"
    )
    return 1 if outcome.lived else 0


if __name__ == "__main__":
    sys.exit(main())
