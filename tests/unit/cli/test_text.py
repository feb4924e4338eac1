"""What commands say is text: brackets stay, in help, messages, tables and progress."""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import typer
from typer.testing import CliRunner

from motord.cli import app
from motord.cli.analysis_command import print_text
from motord.cli.console import (
    fail,
    plain_console,
    print_line,
    progress_bar,
    remark,
    with_kinds,
)
from motord.config import ConfigError
from motord.config.experiments import plan_kinds
from motord.report.text import TextTable

CLI = Path(__file__).parents[3] / "src" / "motord" / "cli"


def commands(command, path=()):
    """Yield every command with its path, groups and hidden ones as well."""
    yield path, command
    context = typer.Context(command)
    for name in command.list_commands(context) if hasattr(command, "list_commands") else ():
        yield from commands(command.get_command(context, name), (*path, name))


ALL = dict(commands(typer.main.get_command(app)))
PYTHON = re.compile(r"\b(str|int|float|bool|Path|list|tuple|dict|None|Any)\b|\brange\b")
PLACES = re.compile(r"\[[a-z][a-z_.*]*\]")


def texts(command):
    """Return all that a command has to say of itself."""
    own = [command.help or ""]
    return own + [getattr(parameter, "help", None) or "" for parameter in command.params]


@pytest.mark.parametrize("path", ALL, ids=" ".join)
def test_sections_in_brackets_are_in_the_help(path):
    result = CliRunner().invoke(app, [*path, "--help"])
    assert result.exit_code == 0
    shown = " ".join(result.stdout.split())
    for text in texts(ALL[path]):
        for place in PLACES.findall(text):
            assert place in shown


@pytest.mark.parametrize("path", ALL, ids=" ".join)
def test_each_option_has_help_and_a_kind_that_is_no_type_of_python(path):
    context = typer.Context(ALL[path])
    for one in ALL[path].get_params(context):
        assert one.hidden or one.help, one.name
        shown, _ = one.get_help_record(context) or ("", "")
        assert not PYTHON.search(shown)


def test_a_typer_that_names_kinds_in_another_way_is_left_alone():
    option = SimpleNamespace()
    assert with_kinds(SimpleNamespace(params=[option])).params == [SimpleNamespace()]


def test_there_are_sections_in_the_help_of_some():
    named = {place for c in ALL.values() for text in texts(c) for place in PLACES.findall(text)}
    assert {"[loop]", "[motor]"} <= named
    assert len(ALL) > 50


def test_wrong_usage_shows_brackets_too():
    result = CliRunner().invoke(app, ["analyse", "[loop]"])
    assert result.exit_code == 2
    assert "[loop]" in result.stderr


def test_consoles_and_columns_print_text_as_it_is():
    from rich.table import Table

    console = plain_console()
    rows = Table("[loop] :cat:", title="[motor]")
    rows.add_row("[brake.modbus] no answer", "runs[loop]/a.mcap")
    with console.capture() as captured:
        console.print("[limits]", rows)
    for text in ("[limits]", "[loop] :cat:", "[motor]", "[brake.modbus]", "runs[loop]/a.mcap"):
        assert text in captured.get()
    with progress_bar("{task.description}") as bars:
        task = bars.add_task("[loop]", total=1.0)
        assert str(bars.columns[0].render(bars.tasks[task])) == "[loop]"


GROUPS = {path: one for path, one in ALL.items() if hasattr(one, "list_commands")}


@pytest.mark.parametrize("path", GROUPS, ids=lambda path: " ".join(path) or "motord")
def test_a_list_of_commands_cuts_no_summary(path):
    result = CliRunner().invoke(app, [*path, "--help"], terminal_width=60)
    assert "..." not in result.stdout.partition("Commands:")[2]


def test_no_figure_of_a_table_is_cut_in_a_file(capsys):
    figures = [f"{number}.25" for number in range(100, 140)]
    print_text([TextTable("mesh", ["", *figures], [["2 Nm", *figures]])])
    shown = capsys.readouterr().out
    assert all(shown.count(f" {figure} ") == 2 for figure in figures), shown


@pytest.mark.parametrize("terminal", [False, True])
def test_no_word_of_a_table_is_cut_where_there_is_room(capsys, monkeypatch, terminal):
    monkeypatch.setenv("COLUMNS", "61")
    monkeypatch.setenv("TERM", "xterm")
    if terminal:
        monkeypatch.setenv("FORCE_COLOR", "1")
    header = ("figure", "mean", "unit", "slope an hour", "drift")
    names = ("rms_error_percent", "inverter_temperature_C", "rms_error_percent of 1, 2 Nm")
    rows = [(name, "0.9716", "degC", "-0.12 +- 0.56", "yes") for name in names]
    print_text([TextTable("slopes", header, rows, left=(0,))])
    shown = re.sub(r"\x1b\[[0-9;]*m", "", capsys.readouterr().out)
    assert max(map(len, shown.splitlines())) <= 61
    words = set(" ".join((*header, *(cell for row in rows for cell in row))).split())
    assert words <= set(shown.split()), shown


def test_a_character_that_the_locale_lacks_is_written_as_an_escape():
    module = "motord.process.standard_streams"
    script = (
        f"import {module}\n{module}.outlive_readers()\nprint('1 \\u03bcA')\n"
        "from motord.cli.console import print_result\nprint_result(None, '2 \\u03bcA', False)"
    )
    ascii_only = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=ascii_only
    )
    assert done.stdout == "1 \\u03bcA\n2 \\u03bcA\n", done.stderr


def test_the_list_of_commands_loads_nothing_heavy():
    script = (
        "import sys\nfrom typer.testing import CliRunner\nfrom motord.cli import app\n"
        "assert CliRunner().invoke(app, ['--help']).exit_code == 0\n"
        "heavy = {'numpy', 'pydantic', 'zenoh', 'rich.progress', 'asyncio', 'importlib.metadata'}\n"
        "print((heavy | {'matplotlib'}) & sys.modules.keys())"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout == "set()\n", done.stderr


def test_a_client_loads_no_statistics_and_nothing_of_bench_files():
    heavy = {"scipy", "numba", "motord.config", "motord.calibration", "motord.sequencing"}
    script = f"import sys, motord.client\nprint({heavy} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout == "set()\n", done.stderr


def test_no_process_looks_for_plugins_of_pydantic():
    script = (
        "import sys\nfrom motord import cli\nsys.argv = ['motord', '--version']\n"
        "cli.end_process = print  # it goes on\ncli.main()\n"
        "from pydantic.plugin import _loader\nimport motord.section\nprint(_loader._plugins)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "None", done.stderr  # they were not looked for


def test_progress_prints_nothing_where_there_is_no_terminal(capfd):
    for silent in (False, True):
        with progress_bar("{task.description}", silent=silent) as bars:
            bars.update(bars.add_task("[loop]", total=1.0), completed=1.0)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("path", sorted(CLI.rglob("*.py")), ids=lambda p: str(p.relative_to(CLI)))
def test_nothing_with_markup_is_made_elsewhere(path):
    made = {
        node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call)
    }
    allowed = {"console.py": {"Console", "TextColumn", "Typer"}, "__init__.py": {"Typer"}}
    marked = made & {"Console", "TextColumn", "Typer", "from_markup", "rprint"}
    assert marked <= allowed.get(str(path.relative_to(CLI)), set())


@pytest.mark.parametrize("name", plan_kinds())
def test_every_plan_has_an_analysis_of_its_name(name):
    result = CliRunner().invoke(app, ["analyse", name, "--help"])
    assert result.exit_code == 0
    assert "RUN" in result.stdout


def test_what_has_several_lines_keeps_them(capsys):
    """As of a bench file with several mistakes, after what a command says of it."""
    error = ConfigError("a.toml:1: one  thing\n\na.toml:2: another")
    with pytest.raises(typer.Exit):
        fail(f"not simulated: {error}")
    first, second = capsys.readouterr().err.splitlines()
    assert first == "motord: not simulated: a.toml:1: one thing"
    assert second == "motord: a.toml:2: another"


@pytest.mark.parametrize(("say", "stream"), [(print_line, "stdout"), (remark, "stderr")])
def test_no_other_thread_writes_between_a_line_and_its_end(say, stream, monkeypatch):
    written = []
    recorder = SimpleNamespace(write=written.append, flush=lambda: None)
    monkeypatch.setattr(sys, stream, recorder)
    say("a line")
    assert [part for part in written if part] == ["a line\n"]
