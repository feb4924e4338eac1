"""The tests of the enable line notice every small change of its source."""

from pathlib import Path

from tests.firmware import line_model, mutate
from tests.firmware.library import Library


def test_all_mutants_of_the_enable_line_are_killed(library: Library, tmp_path: Path) -> None:
    assert line_model.check(library.ffi, library.lib) is None
    chosen = mutate.mutants(mutate.SOURCE.read_text(encoding="utf-8"))
    outcome = mutate.examine(chosen, tmp_path)
    assert outcome.lived == []
    assert len(outcome.killed) == len(chosen) > 100


def test_every_line_that_does_something_is_changed() -> None:
    """Of each statement and condition there is a mutant."""
    source = mutate.SOURCE.read_text(encoding="utf-8")
    changed = {mutant.line for mutant in mutate.mutants(source)}
    for number, line in enumerate(source.splitlines(), 1):
        acts = line.startswith("    ") and (line.endswith(";") or " if (" in line)
        assert acts <= (number in changed), line
