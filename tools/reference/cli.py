"""The page of the command line: every command with its options, and examples from the docs."""

import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import typer
from tools.code_blocks import REFERENCE, blocks, commands, pages
from tools.reference.bench_file import anchor
from tools.reference.markdown import code, page, table

from motord.cli import app

EXAMPLES = 3
INTRO = """Every command ends with exit code 0 (done), 1 (failed: one line on stderr says what,
where and what to do) or 2 (wrong usage). `--json` prints the result as JSON. Commands that reach a
daemon take `--bench`, `--connect` and `--identity`; those that need command of the bench take
`--force`. How to operate a bench with them:
[On the command line](../api.md#on-the-command-line)."""
EVERYWHERE = ("--help", "--install-completion", "--show-completion")
"""Options that are not listed at each command."""


@dataclass(frozen=True)
class Command:
    """A command of the tree: its names from `motord` on, itself, its context."""

    path: tuple[str, ...]
    command: Any
    context: Any

    @property
    def name(self) -> str:
        """As it is typed."""
        return " ".join(self.path)

    @property
    def group(self) -> bool:
        """True if it has commands below it."""
        return hasattr(self.command, "list_commands")


def tree() -> list[Command]:
    """Return all commands, groups before what is below them."""
    root: Any = typer.main.get_command(app)
    context = root.make_context("motord", [], resilient_parsing=True)
    return list(_below(Command(("motord",), root, context)))


def _below(above: Command) -> Iterator[Command]:
    yield above
    if above.group:
        for name in above.command.list_commands(above.context):
            command = above.command.get_command(above.context, name)
            if not command.hidden:
                context = command.make_context(
                    name, [], parent=above.context, resilient_parsing=True
                )
                yield from _below(Command((*above.path, name), command, context))


def cli() -> str:
    """Return the page."""
    found = tree()[1:]
    overview = [
        (f"[`{one.name}`](#{anchor(one.name)})", _first_sentence(one))
        for one in found
        if not one.group
    ]
    examples = _examples(found)
    parts = [part for one in found for part in _section(one, examples.get(one.path, []))]
    return page("The command line", "motord.cli", INTRO, table(("command", ""), overview), *parts)


def _text(one: Command) -> str:
    paragraphs = inspect.cleandoc(one.command.help or "").split("\n\n")
    return "\n\n".join(" ".join(part.split()) for part in paragraphs)


def _first_sentence(one: Command) -> str:
    return _text(one).split("\n\n")[0]


def _section(one: Command, examples: list[str]) -> Iterator[str]:
    yield f"{'##' if len(one.path) == 2 else '###'} {one.name}"
    yield _text(one)
    if one.group:
        return
    usage = one.context.command.collect_usage_pieces(one.context)
    yield "Usage: " + code(" ".join([one.name, *usage]))
    shown = [p for p in one.command.get_params(one.context) if not set(p.opts) & set(EVERYWHERE)]
    records = [record for each in shown if (record := each.get_help_record(one.context))]
    rows = [(code(names), meaning) for names, meaning in records]
    if rows:
        yield table(("option", "meaning"), rows)
    if examples:
        yield "\n".join(["```sh", *examples, "```"])


def _examples(found: list[Command]) -> dict[tuple[str, ...], list[str]]:
    """Return what README and docs have of each command, the first few of each."""
    leaves = sorted((one.path for one in found if not one.group), key=len, reverse=True)
    taken: dict[tuple[str, ...], list[str]] = {}
    for block in blocks(path for path in pages() if REFERENCE not in path.parents):
        if block.language in ("sh", "console"):
            for line in commands(block):
                arguments = tuple(re.split(r"\s+", line))
                path = next((path for path in leaves if arguments[: len(path)] == path), None)
                if path and line not in taken.setdefault(path, []) and arguments != path:
                    taken[path].append(line)
    return {path: lines[:EXAMPLES] for path, lines in taken.items()}
