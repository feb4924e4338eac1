"""Output of every command: a clear line for what is wrong, JSON on request, no markup anywhere.

What stands in brackets, such as [loop], is text: in help, messages, tables and progress. So
consoles and columns of rich, and groups of typer, are made here alone.
"""

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

import typer
from typer.core import TyperGroup

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, TaskID
    from rich.table import Table

    from motord.experiments.subject import PhaseProgress


def fail(message: str) -> NoReturn:
    """Print a message on stderr, its lines one by one, and end with exit code 1."""
    for line in filter(str.strip, message.splitlines()):
        remark(f"motord: {' '.join(line.split())}")
    raise typer.Exit(1)


def fail_with(errors: Sequence[str]) -> None:
    """Print each error on a line of stderr; end with exit code 1 if there is any."""
    if errors:
        fail("\n".join(errors))


def remark(line: str) -> None:
    """Print a line on stderr, for people; it is no part of the result."""
    _print_whole(line, sys.stderr)


def print_line(line: str) -> None:
    """Print a line on stdout now, also into a pipe: for what goes on."""
    _print_whole(line, sys.stdout)


def _print_whole(line: str, stream: TextIO) -> None:
    """Write a line with its end at once: `print` by itself lets other threads write in between."""
    print(f"{line}\n", end="", file=stream, flush=True)


def print_json(obj: Any) -> None:
    """Print `obj` as one JSON document on stdout."""
    print(json.dumps(obj, indent=2, allow_nan=True))  # noqa: T201


def print_result(result: Any, text: str, as_json: bool) -> None:
    """Print the result of a command: JSON as for `print_json`, or the text unless it is empty."""
    if as_json:
        print_json(result)
    elif text:
        print_line(text)


KINDS = {"str": "text", "int": "whole number", "float": "number", "Path": "path"}
"""What a value is called in the help, by the name of its type."""


def with_kinds(command: Any) -> Any:
    """Return a command (or None) whose help says what its values are, without types of Python.

    With a typer that names them by another method than that of 0.29, the help has its types.
    """
    for one in command.params if command else ():
        if named := getattr(type(one), "display_type", None):
            one.display_type = partial(_kind, named, one)
    return command


def _kind(display_type: Callable[..., str], parameter: Any, ctx: Any) -> str:
    """Return the kind of a value as the help shows it; that there may be several is in its name."""
    name = display_type(parameter, ctx).strip("<>").removeprefix("list[").removesuffix("]")
    kinds = (KINDS.get(one, one) for one in name.removesuffix(" range").split(","))
    return f"<{','.join(kinds)}>"


class CommandGroup(TyperGroup):
    """Carries out a command; an error that is none of the program ends it with one line."""

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command, or None if there is none of that name."""
        return with_kinds(super().get_command(ctx, cmd_name))

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the commands with all of their summaries, however narrow the terminal is."""
        commands = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        shown = [(name, one) for name, one in commands if one is not None and not one.hidden]
        with formatter.section("Commands"):
            formatter.write_dl([(name, one.get_short_help_str(sys.maxsize)) for name, one in shown])

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that is asked for; of an unknown one say which may be meant.

        Typer compares with commands that are loaded already, of which a lazy group has none.
        """
        names = self.list_commands(ctx)
        known = args[0] in names or self.get_command(ctx, args[0]) is not None  # an alias
        if not known and not ctx.resilient_parsing and (near := get_close_matches(args[0], names)):
            ctx.fail(f"No such command {args[0]!r}; did you mean {' or '.join(near)}?")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Carry out a command."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            fail("interrupted")
        except Exception as error:
            if interrupt_was_converted(error):
                fail("interrupted")
            _name_value(error)
            if (message := explanation(error)) is None:
                raise
            fail(message)


NO_NUMBER = {
    "float_parsing": "takes a number with a decimal point, without its unit",
    "int_parsing": "takes a whole number",
}
"""What is wrong with an option's value, by pydantic's name of it."""


def _name_value(error: Exception) -> None:
    """Complete what Typer says of an option: what pydantic refuses it does not show."""
    cause: Any = error.__cause__
    if isinstance(error, typer.BadParameter) and type(cause).__name__ == "ValidationError":
        wrong = cause.errors(include_url=False)[0]
        what = NO_NUMBER.get(wrong["type"], error.message.removeprefix("Value error, "))
        value = repr(wrong["input"])
        error.message = what if value in what else f"{what}, got {value}"


def interrupt_was_converted(error: Exception) -> bool:
    """Return whether an error is an interrupt that compiled code reports as an error of its own.

    pydantic does, of one that comes while it builds a model.
    """
    return "KeyboardInterrupt" in str(error) and type(error).__module__.startswith("pydantic_core")


def explanation(error: Exception) -> str | None:
    """Return what an error says that is none of the program, None for one that may be.

    Errors with a class in motord say what is wrong, where and what to do.
    """
    if isinstance(error, OSError):
        if isinstance(error, FileNotFoundError) and not error.filename and _working_folder_gone():
            return "the working folder was removed; change to another one"
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror or error}"
    if str(error) == "can't start new thread":  # of CPython
        from motord.process.ending_threads import NO_THREAD

        return NO_THREAD
    own = any(one.__module__.startswith("motord.") for one in type(error).__mro__)
    return str(error) or None if own else None


def _working_folder_gone() -> bool:
    try:
        Path.cwd()
    except FileNotFoundError:
        return True
    return False


def group(summary: str, kind: type[CommandGroup] = CommandGroup) -> typer.Typer:
    """Return a group of commands with this help."""
    return typer.Typer(
        cls=kind,
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        help=summary,
    )


def single(name: str, function: Callable[..., Any]) -> Any:
    """Return one command, that of no group."""
    app = group("")
    app.command(name)(function)
    command = typer.main.get_command(app)
    command.name = name
    return with_kinds(command)


def plain_console(*, stderr: bool = False) -> "Console":
    """Return a console of rich that prints text as it is."""
    from rich.console import Console

    return Console(stderr=stderr, markup=False, emoji=False)


def print_table(table: "Table") -> None:
    """Print a table, no figure or word of which is cut if there is room for its longest ones.

    A file gets it as wide as its figures need.
    """
    console = plain_console()
    for column in table.columns:
        column.overflow = "fold"
    unlimited = console.options.update(width=sys.maxsize)
    needed = console.measure(table, options=unlimited)
    if needed.minimum > console.width:
        if not console.is_terminal:
            console.width = needed.maximum
    elif needed.maximum > console.width:
        _narrow(table, console, needed.maximum - console.width)
    console.print(table)


def _narrow(table: "Table", console: "Console", excess: int) -> None:
    """Take characters from the widest columns, of none so many that a word of it is cut.

    rich takes them from the widest without regard to words.
    """
    from rich.measure import measure_renderables

    unlimited = console.options.update(width=sys.maxsize)
    needed = [
        measure_renderables(console, unlimited, (column.header, *column.cells))
        for column in table.columns
    ]
    widths = [one.maximum for one in needed]
    for _ in range(excess):
        spare = [n for n, one in enumerate(needed) if widths[n] > one.minimum]
        widths[max(spare, key=widths.__getitem__)] -= 1
    for column, width in zip(table.columns, widths, strict=True):
        column.width = width


def progress_bar(
    *columns: str, silent: bool = False, stderr: bool = False, transient: bool = False
) -> "Progress":
    """Return a progress bar; where there is no terminal, or if it is `silent`, it shows nothing.

    columns: "bar", "count", "elapsed", "left", or a format string over `task`.
    """
    from rich import progress

    kinds = {
        "bar": progress.BarColumn, "count": progress.MofNCompleteColumn,
        "elapsed": progress.TimeElapsedColumn, "left": progress.TimeRemainingColumn,
    }  # fmt: skip
    made = (kinds[c]() if c in kinds else progress.TextColumn(c, markup=False) for c in columns)
    console = plain_console(stderr=stderr)
    console.quiet = silent or not console.is_terminal  # rich below 14.3 ends what is disabled, too
    return progress.Progress(*made, console=console, transient=transient, disable=console.quiet)


@contextmanager
def phase_bars(*, silent: bool = False) -> "Iterator[PhaseProgress]":
    """Show a bar for each phase of a computation as it begins; what is yielded moves it.

    On standard error, and gone in the end.
    """
    columns = "{task.description}", "bar", "left"
    with progress_bar(*columns, silent=silent, stderr=True, transient=True) as bars:
        tasks: dict[str, TaskID] = {}

        def progress(phase: str, fraction: float) -> None:
            if phase not in tasks:
                tasks[phase] = bars.add_task(phase, total=1.0)
            bars.update(tasks[phase], completed=fraction)

        yield progress


def explain_first_run(*, silent: bool = False) -> None:
    """Say on stderr that the kernels are being compiled, if none of this version are kept yet.

    Raises OSError, which says what to do, if they cannot be kept.
    """
    from motord.kernel_cache import usable_kernel_cache

    if not usable_kernel_cache().exists() and not silent:
        remark("first run: compiling the numerical kernels, which takes a minute or two, once")
