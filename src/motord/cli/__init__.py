"""The command line. Modules here parse arguments and print; they import the rest when called."""

import sys
from contextlib import ExitStack
from importlib import import_module
from typing import Annotated, Any

import typer

from motord.cli.connection_options import with_connection
from motord.cli.console import CommandGroup, print_line, remark, single
from motord.process.hidden_packages import hide_pydantic_plugins
from motord.process.interrupts import ending_as_interrupts, recover_lost_interrupts
from motord.process.left_threads import end_process
from motord.process.module_command import shield_from_working_folder
from motord.process.standard_streams import lost_output, outlive_readers

COMMANDS = {
    "demo": "motord.cli.reproduce:demo",
    "new": "motord.cli.setup.new:new",
    "reproduce": "motord.cli.reproduce:reproduce",
    "run": "motord.cli.run:run",
    "emulate": "motord.cli.emulate:emulate",
    "fault": "motord.cli.emulate:app",
    "check": "motord.cli.check:check",
    "service": "motord.cli.setup.service:app",
    "status": "motord.cli.bench.status:status",
    "watch": "motord.cli.bench.watch.command:watch",
    "events": "motord.cli.bench.status:events",
    "dashboard": "motord.cli.viewers:dashboard",
    "enable": "motord.cli.bench.operate:enable",
    "disable": "motord.cli.bench.operate:disable",
    "stop": "motord.cli.bench.operate:stop",
    "reset": "motord.cli.bench.operate:reset",
    "set": "motord.cli.bench.operate:set_",
    "note": "motord.cli.bench.operate:note",
    "plan": "motord.cli.plan.commands:app",
    "queue": "motord.cli.plan.queue:app",
    "learn": "motord.cli.plan.learn:learn",
    "analyse": "motord.cli.analysis_command:app",
    "test": "motord.cli.motor_test.command:run_test",
    "simulate": "motord.cli.simulate:simulate",
    "calibration": "motord.cli.calibration.commands:app",
    "results": "motord.cli.results.commands:app",
    "record": "motord.cli.record.commands:app",
    "archive": "motord.cli.record.archiving:archive",
    "security": "motord.cli.security:app",
    "bridge": "motord.cli.viewers:app",
    "latency": "motord.cli.latency:latency",
}
"""Command to `module:object`; the object is a function or a typer app."""


WRITE_FILES = (
    "analyse", "calibration", "demo", "emulate", "record", "reproduce", "results", "security",
    "simulate",
)  # fmt: skip
"""Commands that SIGTERM and SIGHUP end as Ctrl-C does, so that no unfinished file stays behind.

Those that move a bench, or go on until they are ended, have handlers of their own, `emulate` once
it has started.
"""

INTERRUPTED_WHILE_READ = 130
"""What Typer ends with if it is interrupted while it reads the command line."""


class _Commands(CommandGroup):
    """Imports a command's module only when it is asked for."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command, or None if there is none of that name."""
        if cmd_name not in COMMANDS:
            return None
        module, _, name = COMMANDS[cmd_name].partition(":")
        found = getattr(import_module(module), name)
        if not isinstance(found, typer.Typer):
            return single(cmd_name, with_connection(found))
        for registered in found.registered_commands:
            assert registered.callback is not None
            registered.callback = with_connection(registered.callback)
        command = typer.main.get_command(found)
        command.name = cmd_name
        return command


app = typer.Typer(
    cls=_Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"max_content_width": 100},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print_line(f"motord {version('motord')}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    """Real-time motor controller and data acquisition for a motor test bench."""


def _exit_code() -> Any:
    """Carry out the command line; return what it ends with."""
    try:
        app()
    except SystemExit as done:
        if done.code != INTERRUPTED_WHILE_READ:
            return done.code
        remark("motord: interrupted")
        return 1
    return 0


def main() -> None:
    """Run the command line: exit code 0 done, 1 failed, 2 wrong usage, 128 + N by signal N."""
    shield_from_working_folder()
    hide_pydantic_plugins()
    recover_lost_interrupts()
    outlive_readers()
    received: list[int] = []
    with ExitStack() as signals:
        if sys.argv[1:] and sys.argv[1] in WRITE_FILES:
            received = signals.enter_context(ending_as_interrupts())
        code = _exit_code()
    if received:
        code = 128 + received[0]
    if lost := lost_output():
        remark(f"motord: cannot write the output: {lost}")
        code = code or 1
    end_process(code)
